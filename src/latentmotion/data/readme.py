"""A prepared folder's page on the Hugging Face Hub: README.md, with terms and counts."""

from __future__ import annotations

from latentmotion.data.report import Part
from latentmotion.data.store import Manifest
from latentmotion.storage.provenance import PIPELINE, front_matter, license_fields

README = "README.md"

_SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))


def readme(manifest: Manifest, parts: tuple[Part, ...], title: str) -> str:
    """Returns the page, with the YAML that the hub reads at its head.

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
    lines = [
        front_matter(head),
        f"# {title}",
        "",
        f"{clips} clips of one person as {manifest.representation} features, {manifest.fps:g} "
        f"frames a second, with {captions} captions; mirrored copies are made when they are read.",
        "",
        "```python",
        "from latentmotion import Dataset",
        "",
        'dataset = Dataset.load("FOLDER")',
        "```",
        "",
        "| source | split | clips | captions | hours |",
        "|---|---|---|---|---|",
        *rows,
        "",
        "## Sources and terms",
        "",
        *sources,
        "",
        "What was left out, and why, is in `report.json`.",
        "",
    ]
    return "\n".join(lines)
