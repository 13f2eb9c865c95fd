"""Evaluation of models: `evaluate(candidate, dataset, evaluator, protocol) -> Report`.

In each replication every candidate answers the same test prompts; the evaluator embeds its motions
and the real ones, and metrics compare them. The ground truth is a row like any other.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from latentmotion.condition.task import TaskName
from latentmotion.data.dataset import Dataset
from latentmotion.errors import InputError, ModelError
from latentmotion.evaluation.candidates import Candidate, Generated, Motions, Prior, Reconstructed
from latentmotion.evaluation.embedding_scores import (
    EmbeddingCache,
    Embeddings,
    Scores,
    caption_multimodality,
    embedding_cache,
    embedding_scores,
    ground_truth_scores,
    measures_multimodality,
    reads_text,
)
from latentmotion.evaluation.evaluators.interface import Evaluator
from latentmotion.evaluation.notes import departures, notes_of, published_ground_truth
from latentmotion.evaluation.position_scores import PositionScores
from latentmotion.evaluation.protocol import (
    CLEAN,
    HELD,
    PAPER,
    PROTOCOLS,
    Lengths,
    Protocol,
    Repeats,
    Replication,
    TestSet,
)
from latentmotion.evaluation.report import GROUND_TRUTH, UNITS, Figure, Report, provenance_of
from latentmotion.progress import counted

__all__ = [
    "CLEAN",
    "GROUND_TRUTH",
    "PAPER",
    "PROTOCOLS",
    "UNITS",
    "Candidate",
    "Figure",
    "Generated",
    "Prior",
    "Protocol",
    "Reconstructed",
    "Repeats",
    "Report",
    "build_test_set",
    "compare",
    "evaluate",
]


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
    test_set = build_test_set(candidates, dataset, evaluator, protocol)
    evaluation = _Evaluation(tuple(candidates), dataset, evaluator, protocol)
    for number in counted(range(protocol.replications), "replications"):
        evaluation.replicate(test_set.replication(number))
    population = protocol.quirks.population_deviation
    rows = {
        row: {name: Figure.of(values, population) for name, values in figures.items()}
        for row, figures in evaluation.values.items()
    }
    published = published_ground_truth(dataset, evaluator)
    wrong = departures(rows[GROUND_TRUTH], published) if published else []
    if wrong:
        warnings.warn("\n".join(wrong), stacklevel=2)
    return Report(
        rows,
        dict.fromkeys(rows, len(test_set.items)),
        protocol,
        provenance_of(candidates, dataset, evaluator),
        tuple(notes_of(test_set, evaluator, published)),
        tuple(wrong),
    )


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
        made, expected = candidate.card.representation, dataset.representation.name
        if made != expected:
            raise ModelError(
                f"model {candidate.card.name!r} makes features {made!r}, {dataset.folder} has "
                f"{expected!r}; evaluate it on data of its own kind"
            )
    needs = _needs(candidates, dataset, evaluator, protocol)
    shortest = max(candidate.card.frames[0] for candidate in candidates)
    longest = min(candidate.card.frames[1] for candidate in candidates)
    longest = min(longest, protocol.max_frames or longest)
    if longest < shortest:
        raise InputError(f"no motion of at most {longest} frames: the model's have {shortest} up")
    held = dataset.representation.name in HELD
    unit = 1 if held or needs == "action" else protocol.unit
    return TestSet(dataset, protocol, needs, Lengths(shortest, longest, unit, held))


def _needs(
    candidates: Sequence[Candidate],
    dataset: Dataset,
    evaluator: Evaluator | None,
    protocol: Protocol,
) -> TaskName:
    """Returns what clips must have: what generators take, or else what the evaluator reads."""
    tasks: set[TaskName] = {c.card.task for c in candidates if c.prompted and not c.reconstructs}
    if len(tasks) > 1:
        raise InputError(f"models of the tasks {', '.join(sorted(tasks))}: evaluate them apart")
    if tasks:
        return tasks.pop()
    clips = dataset.clips(protocol.split)
    captioned, labelled = any(c.captions for c in clips), any(c.action for c in clips)
    by_text = evaluator is None or reads_text(evaluator)
    if by_text and captioned and any(candidate.reconstructs for candidate in candidates):
        return "text"
    return "action" if not by_text and labelled else "unconditional"


@dataclass(eq=False)
class _Evaluation:
    """Figures of every row, replication by replication."""

    candidates: tuple[Candidate, ...]
    dataset: Dataset
    evaluator: Evaluator | None
    protocol: Protocol
    values: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    _real: tuple[Embeddings | None, Scores] | None = None

    def __post_init__(self) -> None:
        self.cache = embedding_cache(self.evaluator) if self.evaluator is not None else None
        self.positions = PositionScores(self.dataset)

    def replicate(self, replication: Replication) -> None:
        """Measures every row once."""
        quirks, features = self.protocol.quirks, replication.features
        if self._real is None or quirks.random_crops or quirks.random_state:
            embeddings = (
                self._embed(self.cache, features, replication, GROUND_TRUTH) if self.cache else None
            )
            self._real = embeddings, self.positions.quality(features)
        real, quality = self._real  # the same motions, but for their captions
        if real is not None and self.cache is not None:
            real = replace(real, texts=self.cache.texts(replication.prompts))
        self._add(GROUND_TRUTH, quality)
        if self._measures_nearest(replication):
            self._add(GROUND_TRUTH, self.positions.nearest(features))
        if real is not None:
            self._add(GROUND_TRUTH, ground_truth_scores(real, self.protocol, replication.number))
        for candidate in self.candidates:
            self._measure(candidate, replication, real)

    def _measure(
        self, candidate: Candidate, replication: Replication, real: Embeddings | None
    ) -> None:
        """Measures a candidate: quality, errors against the real motions, embeddings."""
        row, protocol, number = candidate.row, self.protocol, replication.number
        motions = candidate(replication, protocol)
        self._add(row, self.positions.quality(motions))
        if not candidate.reconstructs and self._measures_nearest(replication):
            self._add(row, self.positions.nearest(motions))
        if candidate.reconstructs:
            mean = np.array(candidate.card.normalizer_mean, np.float32)
            padding = mean if protocol.quirks.padded_sums else None
            errors = self.positions.reconstruction(motions, replication.features, padding)
            self._add(row, errors)
        if candidate.reconstructs or (candidate.prompted and candidate.card.condition.reads_text):
            self._add(row, self.positions.average_errors(motions, replication.features))
        if real is None or self.cache is None:
            return
        embeddings = self._embed(self.cache, motions, replication, row)
        self._add(row, embedding_scores(embeddings, real, candidate.prompted, protocol, number))
        if isinstance(candidate, Generated) and measures_multimodality(candidate, protocol, number):
            figure = caption_multimodality(candidate, replication, self.cache, protocol)
            self._add(row, {"MultiModality": figure})

    def _embed(
        self, cache: EmbeddingCache, motions: Motions, replication: Replication, row: str
    ) -> Embeddings:
        drawn = self.protocol.quirks.random_state
        noise = self.protocol.generator(f"state {row}", replication.number) if drawn else None
        return cache.embed(motions, replication, noise)

    def _measures_nearest(self, replication: Replication) -> bool:
        return self.protocol.nearest_clip and replication.number == 0

    def _add(self, row: str, scores: Scores) -> None:
        for name, value in scores.items():
            self.values.setdefault(row, {}).setdefault(name, []).append(value)
