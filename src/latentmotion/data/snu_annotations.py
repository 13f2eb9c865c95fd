"""The spans that Seoul National University's basketball and martial arts takes are labeled with.

A `.lab` file holds blocks of `key:value` lines between braces: which file, from which frame to
which, what the person does there.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from latentmotion.data.finding import files_below
from latentmotion.data.segments import LONGEST
from latentmotion.errors import FileFormatError

GAP, AROUND, LEAST = 12, 4, 24
"""Frames between stretches of one group, taken before and after it, and of the shortest one."""


@dataclass(frozen=True)
class Span:
    """One labeled stretch of a take."""

    start: int
    """First frame."""
    end: int
    """One past the last frame."""
    action: str
    """What the person does, in the annotators' word, such as `shoot`; `'` means it is done to
    them."""

    def at(self, part: float) -> Span:
        """Returns the same stretch at `part` times as many frames per second."""
        return Span(round(self.start * part), round(self.end * part), self.action)


@dataclass(frozen=True)
class Group:
    """Labeled stretches that follow each other closely."""

    start: int
    """First frame."""
    end: int
    """One past the last frame."""
    actions: tuple[str, ...]
    """What the person does, in order."""


def grouped(spans: Sequence[Span], frames: int) -> list[Group]:
    """Joins stretches that are less than `GAP` apart, and makes each at least `LEAST` long.

    Args:
        spans: Stretches at 20 frames per second, in order.
        frames: Length of the take.
    """
    groups: list[Group] = []
    for span in spans:
        last = groups[-1] if groups else None
        if last and span.start - last.end < GAP and span.end - last.start + 2 * AROUND <= LONGEST:
            end = max(last.end, span.end)
            groups[-1] = Group(last.start, end, (*last.actions, span.action))
        else:
            groups.append(Group(span.start, span.end, (span.action,)))
    return [_widened(group, frames) for group in groups]


def _widened(group: Group, frames: int) -> Group:
    around = max(AROUND, (LEAST - group.end + group.start + 1) // 2)
    return replace(group, start=max(0, group.start - around), end=min(frames, group.end + around))


def read_annotations(folder: Path) -> dict[str, list[Span]]:
    """Returns the labeled stretches of each file, by its name without ending, in order.

    Raises:
        FileFormatError: A label file is damaged.
    """
    found: dict[str, list[Span]] = defaultdict(list)
    for path in files_below(folder, [".lab"]):
        if path.parent.name != "annotation":  # The others mark where takes may be joined.
            continue
        for block in _blocks(path):
            span = _span(path, block)
            if block.get("include", "").lower() != "false" and span.action:
                found[Path(block.get("file", "")).stem].append(span)
    return {name: sorted(spans, key=lambda span: span.start) for name, spans in found.items()}


def _blocks(path: Path) -> Iterator[dict[str, str]]:
    text = path.read_text(encoding="utf-8", errors="replace")
    for block in text.split("{")[1:]:
        pairs = (line.partition(":") for line in block.partition("}")[0].splitlines())
        yield {key.strip(): value.strip() for key, _, value in pairs if key.strip()}


def _span(path: Path, block: dict[str, str]) -> Span:
    try:
        start, end = int(block["startFrame"]), int(block["endFrame"])
    except (KeyError, ValueError) as error:
        problem = f"expected frames in startFrame and endFrame, found {error}"
        raise FileFormatError(path, problem) from error
    return Span(start, end + 1, block.get("type", "").lower())
