"""What came of preparing a data set: clips, captions, hours, and what was dropped and why."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from latentmotion.data.manifest import Manifest
from latentmotion.data.recording import Dropped

REPORT = "report.json"


@dataclass(frozen=True)
class Part:
    """Figures of one split of one source; mirrored copies are not counted."""

    source: str
    """Name of the source."""
    split: str
    """Name of the split."""
    clips: int
    """Number of clips."""
    captions: int
    """Number of captions."""
    hours: float
    """Length of all clips."""


@dataclass(frozen=True)
class Report:
    """What came of preparing a data set."""

    parts: tuple[Part, ...]
    """Figures by source and split."""
    dropped: tuple[Dropped, ...]
    """Clips and captions that were left out."""
    round_trip_mm: float | None
    """Largest distance of any joint after joints → features → joints; none for given features."""
    notes: tuple[str, ...] = ()
    """What else the user should know."""

    def text(self) -> str:
        """Returns the report for the terminal."""
        rows = [self.table(), *_dropped_lines(self.dropped)]
        if self.round_trip_mm is not None:
            rows.append(
                f"joints → features → joints: off by {self.round_trip_mm:.3f} mm at the most"
            )
        return "\n".join([*rows, *self.notes])

    def table(self) -> str:
        """Returns the figures by source and split."""
        head = f"{'source':<12}{'split':<8}{'clips':>8}{'captions':>10}{'hours':>8}"
        return "\n".join([head, *map(_row, (*self.parts, _total(self.parts)))])


def parts_of(manifest: Manifest) -> tuple[Part, ...]:
    """Counts a prepared folder."""
    groups = Counter((clip.source, clip.split) for clip in manifest.clips)
    return tuple(_part(manifest, *key) for key in sorted(groups))


def _part(manifest: Manifest, source: str, split: str) -> Part:
    clips = [c for c in manifest.clips if (c.source, c.split) == (source, split)]
    hours = sum(clip.frames for clip in clips) / manifest.fps / 3600
    return Part(source, split, len(clips), sum(len(c.captions) for c in clips), round(hours, 4))


def _total(parts: tuple[Part, ...]) -> Part:
    clips, captions = sum(p.clips for p in parts), sum(p.captions for p in parts)
    return Part("all", "", clips, captions, sum(p.hours for p in parts))


def _row(part: Part) -> str:
    return f"{part.source:<12}{part.split:<8}{part.clips:>8}{part.captions:>10}{part.hours:>8.3f}"


def _dropped_lines(dropped: tuple[Dropped, ...]) -> list[str]:
    kinds = Counter(item.what for item in dropped)
    counts = ", ".join(f"{count} {kind}s" for kind, count in sorted(kinds.items()))
    shown = [f"  {item.what} {item.id}: {item.reason}" for item in dropped]
    return [f"dropped: {counts or 'nothing'}", *shown]
