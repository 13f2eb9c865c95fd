"""Measures models by a protocol: `evaluate(subject, dataset, extractor, protocol) -> Report`.

For each replication: questions are asked, real motions answer them, and so does each subject; the
evaluator looks at all answers, and the metrics at what it saw. The ground truth is a row like any.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from latentmotion.condition.task import TaskName
from latentmotion.data.dataset import Dataset
from latentmotion.errors import InputError, ModelError
from latentmotion.evaluation.bodies import on_stand_in
from latentmotion.evaluation.feature_scores import Scores, feature_scores, truth_scores
from latentmotion.evaluation.observation import Extractor, Observer, View, observer_of, reads_text
from latentmotion.evaluation.origin import official, provenance_of
from latentmotion.evaluation.position_scores import PositionScores
from latentmotion.evaluation.published import PublishedTruth, departures, published_truth
from latentmotion.evaluation.remarks import remarks
from latentmotion.evaluation.repeats import asked_for, repeated_multimodality
from latentmotion.evaluation.report import TRUTH, UNITS, Figure, Report
from latentmotion.evaluation.settings import CLEAN, PAPER, PROTOCOLS, Protocol, Repeats
from latentmotion.evaluation.subject import Generated, Motions, Prior, Reconstructed, Subject
from latentmotion.evaluation.trials import HELD, Lengths, Plan, Trial

__all__ = [
    "CLEAN",
    "PAPER",
    "PROTOCOLS",
    "TRUTH",
    "UNITS",
    "Figure",
    "Generated",
    "Prior",
    "Protocol",
    "Reconstructed",
    "Repeats",
    "Report",
    "Subject",
    "compare",
    "evaluate",
    "plan_of",
]


def evaluate(
    subject: Subject, dataset: Dataset, extractor: Extractor | None, protocol: Protocol = CLEAN
) -> Report:
    """Measures one model.

    Args:
        subject: The model, as generator, reconstructor or prior.
        dataset: Where questions and real motions come from.
        extractor: The evaluator; without one only metrics of positions are reported.
        protocol: How it is measured.

    Raises:
        DataError: The split has nothing to ask for.
        InputError: Model, evaluator and data do not fit.
        ModelError: The model's features are not those of the data.
    """
    return compare([subject], dataset, extractor, protocol)


def compare(
    subjects: Sequence[Subject],
    dataset: Dataset,
    extractor: Extractor | None,
    protocol: Protocol = CLEAN,
) -> Report:
    """Measures several models, each with a row of its own, on the same questions.

    Raises:
        DataError: As for `evaluate`.
        InputError: As for `evaluate`, or the rows do not differ in name or are asked differently.
        ModelError: As for `evaluate`.
    """
    plan = plan_of(subjects, dataset, extractor, protocol)
    measured = _Measured(tuple(subjects), dataset, extractor, protocol)
    for replication in range(protocol.replications):
        measured.replicate(plan.trial(replication))
    return _report(measured, plan, remarks(plan, extractor))


def plan_of(
    subjects: Sequence[Subject],
    dataset: Dataset,
    extractor: Extractor | None,
    protocol: Protocol = CLEAN,
) -> Plan:
    """Returns what subjects will be asked.

    Raises:
        DataError: As for `evaluate`.
        InputError: As for `compare`.
        ModelError: As for `evaluate`.
    """
    _check(subjects, dataset)
    needs = _needs(subjects, dataset, extractor, protocol)
    return Plan(dataset, protocol, needs, _lengths(subjects, dataset, needs, protocol))


@dataclass(eq=False)
class _Measured:
    """What is found, replication by replication."""

    subjects: tuple[Subject, ...]
    dataset: Dataset
    extractor: Extractor | None
    protocol: Protocol
    values: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    _observer: Observer | None = None
    _truth: tuple[View | None, Scores] | None = None

    def __post_init__(self) -> None:
        self._observer = observer_of(self.extractor) if self.extractor is not None else None
        self.positions = PositionScores(self.dataset)

    def replicate(self, trial: Trial) -> None:
        """Measures every row once."""
        truth, quality = self._real(trial)
        self._keep(TRUTH, trial, trial.features, quality)
        if truth is not None:
            self._add(TRUTH, truth_scores(truth, self.protocol, trial.replication))
        for subject in self.subjects:
            self._subject(subject, trial, truth)

    def _subject(self, subject: Subject, trial: Trial, truth: View | None) -> None:
        motions = subject(trial, self.protocol)
        self._keep(subject.row, trial, motions, self.positions.quality(motions))
        if subject.repeats:
            padding = self._padding(subject)
            self._add(subject.row, self.positions.repeated(motions, trial.features, padding))
        if subject.repeats or (subject.prompted and subject.card.condition.reads_text):
            self._add(subject.row, self.positions.compared(motions, trial.features))
        if truth is None or self._observer is None:
            return
        view, replication = self._view(motions, trial, subject.row), trial.replication
        scores = feature_scores(view, truth, subject.prompted, self.protocol, replication)
        self._add(subject.row, scores)
        if isinstance(subject, Generated) and asked_for(subject, self.protocol, replication):
            found = repeated_multimodality(subject, trial, self._observer, self.protocol)
            self._add(subject.row, {"MultiModality": found})

    def _real(self, trial: Trial) -> tuple[View | None, Scores]:
        """Looks at the real motions; at the same ones only once, but for their captions."""
        quirks = self.protocol.quirks
        if self._truth is None or quirks.random_crops or quirks.random_state:
            self._truth = (
                self._view(trial.features, trial, TRUTH) if self._observer else None,
                self.positions.quality(trial.features),
            )
        view, quality = self._truth
        if view is not None and self._observer is not None:
            view = View(
                view.features, view.logits, view.labels, self._observer.captions(trial.questions)
            )
        return view, quality

    def _view(self, motions: Motions, trial: Trial, row: str) -> View:
        assert self._observer is not None
        drawn = self.protocol.quirks.random_state
        noise = self.protocol.generator(f"state {row}", trial.replication) if drawn else None
        return self._observer.view(motions, trial, noise)

    def _keep(self, row: str, trial: Trial, motions: Motions, quality: Scores) -> None:
        self._add(row, quality)
        repeats = any(subject.row == row and subject.repeats for subject in self.subjects)
        if self.protocol.nearest_clip and trial.replication == 0 and not repeats:
            self._add(row, self.positions.nearest(motions))

    def _padding(self, subject: Subject) -> np.ndarray | None:
        if not self.protocol.quirks.padded_sums:
            return None
        return np.array(subject.card.normalizer_mean, np.float32)

    def _add(self, row: str, scores: Scores) -> None:
        for name, value in scores.items():
            self.values.setdefault(row, {}).setdefault(name, []).append(value)


def _report(measured: _Measured, plan: Plan, notes: Sequence[str]) -> Report:
    protocol, dataset, extractor = measured.protocol, measured.dataset, measured.extractor
    population = protocol.quirks.population_deviation
    rows = {
        row: {name: Figure.of(values, population) for name, values in figures.items()}
        for row, figures in measured.values.items()
    }
    sources = [source.name for source in dataset.sources]
    comparable = official(extractor) and not on_stand_in(dataset, extractor)
    published = published_truth(sources, comparable)
    wrong = departures(rows[TRUTH], published) if published else []
    if wrong:
        warnings.warn("\n".join(wrong), stacklevel=3)
    made = provenance_of(measured.subjects, dataset, extractor)
    counts = dict.fromkeys(rows, len(plan.items))
    return Report(
        rows, counts, protocol, made, (*notes, *_held(extractor, published)), tuple(wrong)
    )


def _held(extractor: Extractor | None, published: PublishedTruth | None) -> list[str]:
    """Says what the ground truth is held against."""
    if published is not None:
        return [f"the ground truth is held against {published.paper}"]
    if extractor is None:
        return []
    return [
        "no published interval is known for this data set with this evaluator: the ground truth "
        "is held against nothing, and no figure that an evaluator gives compares with papers'"
    ]


def _check(subjects: Sequence[Subject], dataset: Dataset) -> None:
    rows = [TRUTH, *(subject.row for subject in subjects)]
    if not subjects or len(set(rows)) < len(rows):
        raise InputError(f"rows {', '.join(rows)}: expected one or more, each of another name")
    for subject in subjects:
        found, wanted = subject.card.representation, dataset.representation.name
        if found != wanted:
            raise ModelError(
                f"model {subject.card.name!r} makes features {found!r}, {dataset.folder} has "
                f"{wanted!r}; evaluate it on data of its own kind"
            )


def _needs(
    subjects: Sequence[Subject], dataset: Dataset, extractor: Extractor | None, protocol: Protocol
) -> TaskName:
    """Returns what clips must have: what generators are asked, else what the evaluator reads."""
    tasks: set[TaskName] = {s.card.task for s in subjects if s.prompted and not s.repeats}
    if len(tasks) > 1:
        raise InputError(f"models of the tasks {', '.join(sorted(tasks))}: evaluate them apart")
    if tasks:
        return tasks.pop()
    clips = dataset.clips(protocol.split)
    captioned, labelled = any(c.captions for c in clips), any(c.action for c in clips)
    by_text = extractor is None or reads_text(extractor)
    if by_text and captioned and any(subject.repeats for subject in subjects):
        return "text"
    return "action" if not by_text and labelled else "unconditional"


def _lengths(
    subjects: Sequence[Subject], dataset: Dataset, needs: TaskName, protocol: Protocol
) -> Lengths:
    shortest = max(subject.card.frames[0] for subject in subjects)
    longest = min(subject.card.frames[1] for subject in subjects)
    longest = min(longest, protocol.max_frames or longest)
    if longest < shortest:
        raise InputError(f"no motion of at most {longest} frames: the model's have {shortest} up")
    held = dataset.representation.name in HELD
    unit = 1 if held or needs == "action" else protocol.unit
    return Lengths(shortest, longest, unit, held)
