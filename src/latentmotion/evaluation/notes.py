"""Notes and warnings of a report: limits of its figures, and departures from published ones.

The ground-truth row depends only on data, evaluator and protocol. If it leaves the published
interval, then the data were processed differently (HumanML3D issues 3 and 21), the evaluator is not
the official one, or its statistics are not those that it was trained with; no other row compares.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from latentmotion.condition.task import TASKS
from latentmotion.data.dataset import Dataset
from latentmotion.evaluation.embedding_scores import reads_text
from latentmotion.evaluation.evaluators.interface import Evaluator
from latentmotion.evaluation.position_scores import lacks_smpl_joints, notes_on_joints
from latentmotion.evaluation.protocol import TestSet
from latentmotion.evaluation.report import Figure


@dataclass(frozen=True)
class PublishedGroundTruth:
    """The ground-truth row of a data set in a paper."""

    source: str
    """Name of the source in a prepared folder."""
    paper: str
    """Paper and table of the figures."""
    figures: Mapping[str, tuple[float, float]]
    """Mean and 95 % interval by metric."""
    split: str = "test"
    """Split that it was measured on."""
    clips: int = 0
    """Clips of the official split, mirrored ones included; 0 if no source states it."""
    items: int | None = None
    """Items that the authors' reader makes of them; none if no source states it."""

    def size(self) -> str:
        """Returns the size of the paper's test set."""
        items = f" and {self.items:,} items" if self.items else ""
        return f"{self.clips:,} clips{items} in {self.split}"


PUBLISHED = tuple(
    PublishedGroundTruth(
        source, **{**row, "figures": {name: tuple(pair) for name, pair in row["figures"].items()}}
    )
    for source, row in tomllib.loads(
        Path(__file__).with_name("published.toml").read_text(encoding="utf-8")
    ).items()
)
"""The real rows of papers."""


def published_ground_truth(
    dataset: Dataset, evaluator: Evaluator | None
) -> PublishedGroundTruth | None:
    """Returns the published row that the ground truth can be compared with.

    None if the evaluator is not the one of the papers or lacks SMPL's joints, or if the data set is
    a mixture of several.
    """
    official = bool(getattr(evaluator, "official", False))
    if not official or lacks_smpl_joints(dataset, evaluator) or len(dataset.sources) != 1:
        return None
    name = dataset.sources[0].name
    return next((row for row in PUBLISHED if row.source == name), None)


def departures(ground_truth: Mapping[str, Figure], published: PublishedGroundTruth) -> list[str]:
    """Returns warnings of figures of the ground truth whose interval misses the published one."""
    return [
        f"the ground truth's {name} is {ground_truth[name]}, published {mean:g} ± {interval:g} "
        f"({published.paper}): data, evaluator or its statistics are not those of the paper, "
        "and no row compares with it"
        for name, (mean, interval) in published.figures.items()
        if name in ground_truth
        and abs(ground_truth[name].mean - mean) > interval + (ground_truth[name].interval or 0.0)
    ]


def other_size(test_set: TestSet, published: PublishedGroundTruth) -> list[str]:
    """Returns a warning if the test set is not as large as the paper's."""
    protocol, clips, items = test_set.protocol, len(test_set.clips), len(test_set.items)
    same = protocol.split == published.split and clips == (published.clips or clips)
    if same and items == (published.items or items):
        return []
    advice = "" if protocol.quirks.mirrored_items else "; use --protocol paper"
    return [
        f"the test set is not the paper's: {clips:,} clips and {items:,} items in "
        f"{protocol.split}, {published.paper} has {published.size()}: FID of fewer motions is "
        f"higher, and no figure compares{advice}"
    ]


def notes_of(
    test_set: TestSet, evaluator: Evaluator | None, published: PublishedGroundTruth | None
) -> list[str]:
    """Returns the notes of a report, a sentence each."""
    protocol, lengths, items = test_set.protocol, test_set.lengths, len(test_set.items)
    clips = len(test_set.clips)
    notes = [
        f"{items} items {TASKS[test_set.needs].asks_for} of {lengths.shortest} to "
        f"{lengths.longest} frames, from {clips} clips of the {protocol.split} split"
    ]
    if evaluator is None:
        notes.append("no evaluator, so metrics of positions alone")
    elif reads_text(evaluator):
        notes += _notes_on_text(test_set, evaluator.width)
    notes += notes_on_joints(test_set.dataset, evaluator)
    if evaluator is not None and not protocol.quirks.permuted_truth:
        notes.append(
            f"FID and KID of the ground truth are between random halves of {items // 2} "
            "motions: the noise of so few, not what a model should reach"
        )
    if protocol.nearest_clip:
        notes.append("the nearest training clip is searched in the first replication only")
    if published is not None:
        notes.append(f"the ground truth is compared with {published.paper}, of {published.size()}")
    elif evaluator is not None:
        notes.append(
            "no published interval is known for this data set with this evaluator: the ground "
            "truth cannot be checked, and no figure from the evaluator compares with papers'"
        )
    return notes


def _notes_on_text(test_set: TestSet, width: int) -> list[str]:
    """Notes on what few items do to metrics of a text-motion evaluator of some width."""
    protocol, items = test_set.protocol, len(test_set.items)
    pairs, repeats, rest = protocol.quirks.drawn_pairs, protocol.repeats, items % protocol.group
    notes = []
    if items < protocol.group:
        notes.append(f"R-precision ranks among {items} motions, since there are no more")
    elif rest and protocol.quirks.remainder_dropped:
        notes.append(
            f"{rest} items of each replication have no R-precision, as in the authors' code"
        )
    if items <= width:
        notes.append(
            f"FID from {items} motions and {width} features is biased upward: compare it with rows "
            "of as many motions alone, or see KID"
        )
    if pairs and items < pairs.text_diversity:
        notes.append(f"diversity is of {items} pairs, not {pairs.text_diversity}")
    if repeats.texts > items:
        notes.append(f"MultiModality is of {items} captions, not {repeats.texts}")
    return notes
