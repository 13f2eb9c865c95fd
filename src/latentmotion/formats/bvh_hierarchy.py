"""The first half of a BVH file: `HIERARCHY`, the tree of joints with offsets and channels."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.errors import FileFormatError
from latentmotion.formats.lines import numbers
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.storage.limits import MOST_JOINTS

_STATEMENT = re.compile(r"([{}])|(?=\b(?:OFFSET|CHANNELS)\b)", re.IGNORECASE)
_KEYWORDS = frozenset({"ROOT", "JOINT", "END", "{", "}", "OFFSET", "CHANNELS", "MOTION"})
_CHANNEL = re.compile(r"([xyz])(position|rotation)", re.IGNORECASE)


@dataclass
class Node:
    """One `ROOT`, `JOINT` or `End Site` block."""

    name: str
    """Its name; an end site is `<parent>_end`."""
    parent: int
    """Index of its parent; -1 for the root."""
    is_end: bool = False
    """Whether it is an end site."""
    offset: Float[np.ndarray, " 3"] | None = None
    """From its parent, in the file's unit; None until its line is read."""
    channels: list[tuple[str, str]] = field(default_factory=list)
    """Axis (`X`) and kind (`position` or `rotation`) of each of its columns."""

    @property
    def order(self) -> str:
        """The axes of its rotation channels, first to last."""
        return "".join(axis for axis, kind in self.channels if kind == "rotation")


def read_hierarchy(path: Path, lines: Sequence[str]) -> tuple[list[Node], int]:
    """Reads up to `MOTION`.

    Args:
        path: The file, for errors.
        lines: All its lines.

    Returns:
        The joints, parents first, and the index of the line after `MOTION`.

    Raises:
        FileFormatError: The hierarchy is damaged.
    """
    reader = _Reader(path)
    for number, line in enumerate(lines, 1):
        for statement in _STATEMENT.split(line):  # several may share a line
            if statement and statement.strip():
                reader.read(number, statement.strip())
                if reader.ended:
                    return reader.nodes, number
    raise FileFormatError(path, "ends before 'MOTION': the file is truncated", len(lines))


def hierarchy_lines(
    skeleton: Skeleton, moving: Collection[int], order: str, joint: int = 0
) -> list[str]:
    """Returns the lines of a joint's block and of all below it, in centimeters.

    Args:
        skeleton: The tree of joints.
        moving: Joints that get position channels.
        order: The axes of the rotation channels, first to last.
        joint: The joint.
    """
    children = skeleton.children(joint)
    positions = [f"{axis}position" for axis in "XYZ"] if joint in moving else []
    channels = positions + [f"{axis}rotation" for axis in order]
    inside = [_offset(skeleton, joint), f"CHANNELS {len(channels)} {' '.join(channels)}"]
    for child in children:
        is_end = child in skeleton.end_sites
        below = hierarchy_lines(skeleton, moving, order, child) if not is_end else []
        inside += below or _end_site(skeleton, child)
    if not children:
        # BVH requires a tip. The true one is unknown; half the bone before it looks right.
        inside += _end_site(skeleton, joint, share=0.5)
    name = "_".join(skeleton.names[joint].split())
    return [f"{'JOINT' if joint else 'ROOT'} {name}", "{", *("\t" + s for s in inside), "}"]


def _end_site(skeleton: Skeleton, joint: int, share: float = 1.0) -> list[str]:
    return ["End Site", "{", "\t" + _offset(skeleton, joint, share), "}"]


def _offset(skeleton: Skeleton, joint: int, share: float = 1.0) -> str:
    centimeters = np.round(100 * share * np.asarray(skeleton.offsets[joint], np.float64), 6)
    # Adding zero makes 0 of the -0 that rounding leaves.
    return "OFFSET " + " ".join(f"{value:.6f}" for value in centimeters + 0.0)


class _Reader:
    """Reads a hierarchy statement by statement."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.nodes: list[Node] = []
        self.ended = False
        self._line = 0
        self._open: list[int] = []
        self._taken: set[str] = set()
        self._copies: dict[str, int] = {}
        self._unopened: int | None = None
        """The joint whose `{` must come next."""

    def read(self, line: int, statement: str) -> None:
        """Reads one statement of line `line`."""
        word, *values = statement.split()
        keyword, found = word.upper(), f"found {statement[:40]!r}"
        is_first, self._line = self._line == 0, line
        if is_first:
            self._check(keyword == "HIERARCHY", f"{found}, expected 'HIERARCHY': not BVH")
            return
        self._check(keyword in _KEYWORDS, f"{found}, expected a keyword of BVH")
        self._check((self._unopened is not None) == (keyword == "{"), f"{found} at a wrong place")
        match keyword:
            case "ROOT":
                problem = "found a second 'ROOT', expected one skeleton per file"
                self._check(not self.nodes, problem)
                self._add(Node(" ".join(values), -1))
            case "JOINT":
                self._add(Node(" ".join(values), self._current()))
            case "END":
                parent = self._current()
                self._add(Node(f"{self.nodes[parent].name}_end", parent, is_end=True))
            case "{":
                assert self._unopened is not None
                self._open.append(self._unopened)
                self._unopened = None
            case "}":
                node = self.nodes[self._current()]
                self._check(node.offset is not None, f"{node.name} has no 'OFFSET'")
                self._open.pop()
            case "OFFSET":
                self.nodes[self._current()].offset = numbers(self.path, line, values, 3)
            case "CHANNELS":
                self._read_channels(values)
            case "MOTION":
                self._check(bool(self.nodes), "found 'MOTION' before any 'ROOT'")
                self._check(not self._open, "found 'MOTION' before the last '}'")
                self.ended = True

    def _read_channels(self, words: list[str]) -> None:
        count, names = (words[0] if words else "none"), words[1:]
        problem = f"'CHANNELS' says {count}, but {len(names)} names follow"
        self._check(count == str(len(names)), problem)
        matches = [match for name in names if (match := _CHANNEL.fullmatch(name))]
        problem = f"found the channels {names}, expected names like 'Xposition' and 'Zrotation'"
        self._check(len(matches) == len(names), problem)
        node = self.nodes[self._current()]
        node.channels = [(match[1].upper(), match[2].lower()) for match in matches]

    def _add(self, node: Node) -> None:
        self._check(len(self.nodes) < MOST_JOINTS, f"more than {MOST_JOINTS:,} joints")
        name, copy = node.name, self._copies.get(node.name, 2)
        while node.name in self._taken:
            node.name, copy = f"{name}_{copy}", copy + 1
        self._copies[name] = copy
        self._taken.add(node.name)
        self._unopened = len(self.nodes)
        self.nodes.append(node)

    def _current(self) -> int:
        self._check(bool(self._open), "found a statement outside the braces of any joint")
        return self._open[-1]

    def _check(self, condition: bool, problem: str) -> None:
        if not condition:
            raise FileFormatError(self.path, problem, self._line)
