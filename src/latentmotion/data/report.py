"""Report of preparing a data set: clips, captions and hours by source, and what was dropped."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from latentmotion.data.recording import Dropped
from latentmotion.data.store import Manifest, StoredClip
from latentmotion.storage.configuration import read_json

REPORT = "report.json"
"""File of a prepared folder that holds its report."""


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

    def row(self) -> str:
        """Returns its row of a report's table."""
        numbers = f"{self.clips:>8} {self.captions:>10} {self.hours:>8.3f}"
        return f"{self.source:<12} {self.split:<8}{numbers}"


@dataclass(frozen=True)
class Report:
    """Result of preparing a data set: clips, captions, hours, and what was dropped and why."""

    parts: tuple[Part, ...]
    """Figures by source and split."""
    dropped: tuple[Dropped, ...]
    """Clips and captions that were left out."""
    round_trip_mm: float | None
    """Largest distance of any joint after joints → features → joints; none for given features."""
    notes: tuple[str, ...] = ()
    """Further remarks for the user."""

    def text(self) -> str:
        """Returns the report for the terminal."""
        kinds = Counter(item.what for item in self.dropped)
        counts = ", ".join(f"{count} {kind}s" for kind, count in sorted(kinds.items()))
        lines = [self.table(), f"dropped: {counts or 'nothing'}"]
        lines += [f"  {item.what} {item.id}: {item.reason}" for item in self.dropped]
        if self.round_trip_mm is not None:
            lines.append(
                f"joints → features → joints: off by {self.round_trip_mm:.3f} mm at the most"
            )
        return "\n".join([*lines, *self.notes])

    def table(self) -> str:
        """Returns the figures by source and split."""
        head = f"{'source':<12} {'split':<8}{'clips':>8} {'captions':>10} {'hours':>8}"
        clips, captions = sum(p.clips for p in self.parts), sum(p.captions for p in self.parts)
        total = Part("all", "", clips, captions, sum(p.hours for p in self.parts))
        return "\n".join([head, *(part.row() for part in (*self.parts, total))])


def parts_of(manifest: Manifest) -> tuple[Part, ...]:
    """Counts clips, captions and hours of a prepared folder by source and split."""
    groups: dict[tuple[str, str], list[StoredClip]] = {}
    for clip in manifest.clips:
        if clip.is_mirrored_copy:
            continue
        groups.setdefault((clip.source, clip.split), []).append(clip)
    parts = []
    for (source, split), clips in sorted(groups.items()):
        hours = sum(clip.frames for clip in clips) / manifest.fps / 3600
        captions = sum(len(clip.captions) for clip in clips)
        parts.append(Part(source, split, len(clips), captions, round(hours, 4)))
    return tuple(parts)


def read_report(folder: Path) -> Report | None:
    """Returns the report in a prepared folder, or None if it has none.

    Raises:
        InputError: It is damaged.
    """
    path = folder / REPORT
    return read_json(Report, path) if path.is_file() else None
