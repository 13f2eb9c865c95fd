"""Report of preparing a data set: clips, captions and hours by source, and what was dropped."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from latentmotion.data.recording import Dropped
from latentmotion.data.store import DatasetManifest, StoredClip
from latentmotion.storage.configuration import read_json
from latentmotion.storage.provenance import PIPELINE, front_matter, license_fields

REPORT = "report.json"  # File of a prepared folder that holds its report.

README = "README.md"

_SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))


@dataclass(frozen=True)
class Part:
    """Figures of one split of one source; mirrored copies are not counted."""

    source: str  # Name of the source.
    split: str  # Name of the split.
    clips: int  # Number of clips.
    captions: int  # Number of captions.
    hours: float  # Length of all clips.

    def row(self) -> str:
        """Returns its row of a report's table."""
        numbers = f"{self.clips:>8} {self.captions:>10} {self.hours:>8.3f}"
        return f"{self.source:<12} {self.split:<8}{numbers}"


@dataclass(frozen=True)
class PreparationReport:
    """Result of preparing a data set: clips, captions, hours, and what was dropped and why."""

    KIND: ClassVar[str] = "Report"  # Its name in files.
    parts: tuple[Part, ...]  # Figures by source and split.
    dropped: tuple[Dropped, ...]  # Clips and captions that were left out.
    # Largest distance of any joint after joints → features → joints; none for given features.
    round_trip_mm: float | None
    notes: tuple[str, ...] = ()  # Further remarks for the user.

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


def parts_of(manifest: DatasetManifest) -> tuple[Part, ...]:
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


def read_report(folder: Path) -> PreparationReport | None:
    """Returns the report in a prepared folder, or None if it has none.

    Raises:
        InputError: It is damaged.
    """
    path = folder / REPORT
    return read_json(PreparationReport, path) if path.is_file() else None


def readme(manifest: DatasetManifest, parts: tuple[Part, ...], title: str) -> str:
    """Returns the folder's page on the Hugging Face Hub, with the YAML that the hub reads.

    Args:
        manifest: Manifest of the folder.
        parts: Counts by source and split.
        title: Name of the data set.
    """
    clips = sum(part.clips for part in parts)
    captions = sum(part.captions for part in parts)
    head = {
        **license_fields(source.license for source in manifest.sources),
        "pretty_name": title,
        "language": ["en"] if captions else None,
        "task_categories": [PIPELINE] if captions else None,
        "size_categories": [next((name for most, name in _SIZES if clips < most), "1M<n<10M")],
        "tags": ["latentmotion", "motion", "motion-capture"],
    }
    rows = [
        f"| {part.source} | {part.split} | {part.clips} | {part.captions} | {part.hours:g} |"
        for part in parts
    ]
    sources = [
        f"* **{source.name}**: {source.license}. {source.credit} {source.url}".rstrip()
        for source in manifest.sources
    ]
    page = Path(__file__).with_name("hub_page.md").read_text(encoding="utf-8")
    return page.format(
        head=front_matter(head),
        title=title,
        clips=clips,
        captions=captions,
        manifest=manifest,
        rows="\n".join(rows),
        sources="\n".join(sources),
    )
