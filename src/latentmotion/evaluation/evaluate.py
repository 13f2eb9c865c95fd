"""Evaluation of models: `evaluate(candidate, dataset, evaluator, protocol) -> Report`.

In each replication every candidate answers the same test prompts; the evaluator embeds its motions
and the real ones, and metrics compare them. The ground truth is a row like any other.

The ground-truth row depends only on data, evaluator and protocol. If it leaves the published
interval, then the data were processed differently (HumanML3D issues 3 and 21), the evaluator is not
the official one, or its statistics are not those that it was trained with; no other row compares.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from latentmotion.data.dataset import Dataset
from latentmotion.diffusion.condition import TASKS, TaskName
from latentmotion.errors import InputError, ModelError
from latentmotion.evaluation import scores as scoring
from latentmotion.evaluation.candidates import Candidate, Generated, Motions
from latentmotion.evaluation.evaluators.interface import Evaluator, TextMotionEvaluator
from latentmotion.evaluation.protocol import CLEAN, HELD, Lengths, Protocol, Replication, TestSet
from latentmotion.evaluation.report import GROUND_TRUTH, Figure, Report, provenance_of
from latentmotion.plugins import plugins
from latentmotion.progress import counted
from latentmotion.storage.configuration import to_json
from latentmotion.storage.reading import packaged_toml, read_json_file
from latentmotion.storage.shards import ShardContent, ShardedRun, ShardManifest, Work


def evaluate(
    candidate: Candidate, dataset: Dataset, evaluator: Evaluator | None, protocol: Protocol = CLEAN
) -> Report:
    """Evaluates one model.

    Args:
        candidate: The model, as a generator, a reconstruction or a prior.
        dataset: Source of test prompts and real motions.
        evaluator: The evaluator; without one only metrics of positions are reported.
        protocol: Rules of the evaluation.

    Raises:
        DataError: The split has no item to ask for.
        InputError: Model, evaluator and data do not fit.
        ModelError: The model's features are not those of the data.
    """
    return compare([candidate], dataset, evaluator, protocol)


def compare(
    candidates: Sequence[Candidate],
    dataset: Dataset,
    evaluator: Evaluator | None,
    protocol: Protocol = CLEAN,
) -> Report:
    """Evaluates several models on the same test prompts, each with its own row.

    Raises:
        DataError: As for `evaluate`.
        InputError: As for `evaluate`, or two rows have the same name, or tasks differ.
        ModelError: As for `evaluate`.
    """
    return Comparison(tuple(candidates), dataset, evaluator, protocol)()


def build_test_set(
    candidates: Sequence[Candidate],
    dataset: Dataset,
    evaluator: Evaluator | None,
    protocol: Protocol = CLEAN,
) -> TestSet:
    """Returns the test set that candidates are evaluated on.

    Raises:
        DataError: As for `evaluate`.
        InputError: As for `compare`.
        ModelError: As for `evaluate`.
    """
    rows = [GROUND_TRUTH, *(candidate.row for candidate in candidates)]
    if not candidates or len(set(rows)) < len(rows):
        raise InputError(f"rows {', '.join(rows)}: expected one or more, each of another name")
    for candidate in candidates:
        name, expected = candidate.card.representation, dataset.representation.name
        if name != expected:
            raise ModelError(
                f"model {candidate.card.name!r} makes features {name!r}, {dataset.folder} has "
                f"{expected!r}; evaluate it on data of its own kind"
            )
    # Clips must have what generators take, or else what the evaluator reads.
    tasks: set[TaskName] = {c.card.task for c in candidates if c.prompted and not c.reconstructs}
    if len(tasks) > 1:
        raise InputError(f"models of the tasks {', '.join(sorted(tasks))}: evaluate them apart")
    clips = dataset.clips(protocol.split)
    by_text = evaluator is None or isinstance(evaluator, TextMotionEvaluator)
    rebuilt = any(candidate.reconstructs for candidate in candidates)
    needs: TaskName = "unconditional"
    if tasks:
        needs = tasks.pop()
    elif by_text and rebuilt and any(clip.captions for clip in clips):
        needs = "text"
    elif not by_text and any(clip.action for clip in clips):
        needs = "action"
    shortest = max(candidate.card.frames[0] for candidate in candidates)
    longest = min(candidate.card.frames[1] for candidate in candidates)
    longest = min(longest, protocol.max_frames or longest)
    if longest < shortest:
        raise InputError(f"no motion of at most {longest} frames: the model's have {shortest} up")
    held = dataset.representation.name in HELD
    unit = 1 if held or needs == "action" else protocol.unit
    return TestSet(dataset, protocol, needs, Lengths(shortest, longest, unit, held))


@dataclass(eq=False)
class Comparison:
    """Models that are measured on the same test prompts, replication by replication.

    A replication's scores depend on its number alone, so any process may measure any of them.
    """

    candidates: tuple[Candidate, ...]  # The models, each with its own row.
    dataset: Dataset  # Source of test prompts and real motions.
    # The evaluator; without one only metrics of positions are measured.
    evaluator: Evaluator | None
    protocol: Protocol = CLEAN  # Rules of the evaluation.
    _real: tuple[scoring.Embeddings | None, scoring.Scores] | None = None

    def __post_init__(self) -> None:
        self.test_set = build_test_set(self.candidates, self.dataset, self.evaluator, self.protocol)
        self.cache = scoring.EmbeddingCache(self.evaluator) if self.evaluator is not None else None
        self.positions = scoring.PositionScores(self.dataset)

    def __call__(self) -> Report:
        """Measures all replications in this process."""
        numbers = counted(range(self.protocol.replications), "replications")
        return self.report([self.replication(number) for number in numbers])

    def replication(self, number: int) -> dict[str, scoring.Scores]:
        """Returns the scores of every row in replication `number`."""
        replication = self.test_set.replication(number)
        quirks, features = self.protocol.quirks, replication.features
        if self._real is None or quirks.random_crops or quirks.random_state:
            embeddings = (
                self._embed(self.cache, features, replication, GROUND_TRUTH) if self.cache else None
            )
            self._real = embeddings, self.positions.quality(features)
        real, scores = self._real  # the same motions, but for their captions
        if real is not None and self.cache is not None:
            real = replace(real, texts=self.cache.texts(replication.prompts))
        scores = scores | self._further(features, features)
        if self._measures_nearest(replication):
            scores = scores | self.positions.nearest(features)
        if real is not None:
            scores = scores | scoring.ground_truth_scores(real, self.protocol, number)
        rows = {
            candidate.row: self._measure(candidate, replication, real)
            for candidate in self.candidates
        }
        return {GROUND_TRUTH: scores, **rows}

    def report(self, replications: Sequence[Mapping[str, scoring.Scores]]) -> Report:
        """Returns the report of the scores of all replications, in their order."""
        population = self.protocol.quirks.population_deviation
        values: dict[str, dict[str, list[float]]] = {}
        for scores in replications:
            for row, figures in scores.items():
                for name, value in figures.items():
                    values.setdefault(row, {}).setdefault(name, []).append(value)
        rows = {
            row: {name: Figure.of(each, population) for name, each in figures.items()}
            for row, figures in values.items()
        }
        published = published_ground_truth(self.dataset, self.evaluator)
        wrong = []
        if published:
            wrong = other_size(self.test_set, published)
            wrong += departures(rows[GROUND_TRUTH], published)
        if wrong:
            warnings.warn("\n".join(wrong), stacklevel=2)
        return Report(
            rows,
            dict.fromkeys(rows, len(self.test_set.items)),
            self.protocol,
            provenance_of(self.candidates, self.dataset, self.evaluator),
            tuple(notes_of(self.test_set, self.evaluator, published)),
            tuple(wrong),
        )

    def work(self) -> Work:
        """Returns the replications as shards, the scores of one in each; see `report_of`."""
        settings = to_json(provenance_of(self.candidates, self.dataset, self.evaluator))
        settings["versions"].pop("machine")  # the shards may be shared among several
        settings["protocol"] = to_json(self.protocol)

        def shard(number: int) -> ShardContent:
            return ShardContent(json.dumps(self.replication(number), indent=1).encode(), 1)

        tasks = {
            f"replication-{number:05d}.json": partial(shard, number)
            for number in range(self.protocol.replications)
        }
        return Work(ShardedRun(settings, len(tasks), tuple(tasks)), tasks)

    def report_of(self, folder: Path, manifest: ShardManifest) -> Report:
        """Returns the report of finished shards.

        Raises:
            DataError: A shard is damaged.
        """
        return self.report([read_json_file(folder / record.name) for record in manifest.shards])

    def _measure(
        self, candidate: Candidate, replication: Replication, real: scoring.Embeddings | None
    ) -> scoring.Scores:
        """Measures a candidate: quality, errors against the real motions, embeddings."""
        protocol, number = self.protocol, replication.number
        motions = candidate(replication, protocol)
        scores = dict(self.positions.quality(motions))
        scores |= self._further(motions, replication.features)
        if not candidate.reconstructs and self._measures_nearest(replication):
            scores |= self.positions.nearest(motions)
        if candidate.reconstructs:
            mean = np.array(candidate.card.normalizer_mean, np.float32)
            padding = mean if protocol.quirks.padded_sums else None
            scores |= self.positions.reconstruction(motions, replication.features, padding)
        if candidate.reconstructs or (candidate.prompted and candidate.card.condition.reads_text):
            scores |= self.positions.average_errors(motions, replication.features)
        if real is None or self.cache is None:
            return scores
        embeddings = self._embed(self.cache, motions, replication, candidate.row)
        scores |= scoring.embedding_scores(embeddings, real, candidate.prompted, protocol, number)
        if isinstance(candidate, Generated) and scoring.measures_multimodality(
            candidate, protocol, number
        ):
            figure = scoring.caption_multimodality(candidate, replication, self.cache, protocol)
            scores["MultiModality"] = figure
        return scores

    def _further(self, motions: Motions, real: Motions) -> scoring.Scores:
        """Returns the metrics that other packages add."""
        added = plugins("latentmotion.metrics").values()
        return {
            name: float(value)
            for metric in added
            for name, value in metric(motions, real, self.dataset.representation).items()
        }

    def _embed(
        self, cache: scoring.EmbeddingCache, motions: Motions, replication: Replication, row: str
    ) -> scoring.Embeddings:
        drawn = self.protocol.quirks.random_state
        noise = self.protocol.generator(f"state {row}", replication.number) if drawn else None
        return cache.embed(motions, replication, noise)

    def _measures_nearest(self, replication: Replication) -> bool:
        return self.protocol.nearest_clip and replication.number == 0


@dataclass(frozen=True)
class PublishedGroundTruth:
    """The ground-truth row of a data set in a paper."""

    source: str  # Name of the source in a prepared folder.
    paper: str  # Paper and table of the figures.
    figures: Mapping[str, tuple[float, float]]  # Mean and 95 % interval by metric.
    split: str = "test"  # Split that it was measured on.
    clips: int = 0  # Clips of the official split, mirrored ones included; 0 if no source states it.
    # Items that the authors' reader makes of them; none if no source states it.
    items: int | None = None

    def size(self) -> str:
        """Returns the size of the paper's test set."""
        items = f" and {self.items:,} items" if self.items else ""
        return f"{self.clips:,} clips{items} in {self.split}"


# The real rows of papers.
PUBLISHED = tuple(
    PublishedGroundTruth(
        source, **{**row, "figures": {name: tuple(pair) for name, pair in row["figures"].items()}}
    )
    for source, row in packaged_toml(__file__, "published.toml").items()
)


def published_ground_truth(
    dataset: Dataset, evaluator: Evaluator | None
) -> PublishedGroundTruth | None:
    """Returns the published row that the ground truth can be compared with.

    None if the evaluator is not the one of the papers or lacks SMPL's joints, or if the data set is
    a mixture of several.
    """
    official = bool(getattr(evaluator, "official", False))
    if not official or scoring.lacks_smpl_joints(dataset, evaluator) or len(dataset.sources) != 1:
        return None
    return next((row for row in PUBLISHED if row.source == dataset.sources[0].name), None)


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
    elif isinstance(evaluator, TextMotionEvaluator):
        notes += _notes_on_text(test_set, evaluator.width)
    notes += scoring.notes_on_joints(test_set.dataset, evaluator)
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
