"""MultiModality of captions: a pass of its own, in which each caption gets many motions."""

from __future__ import annotations

import numpy as np

from latentmotion.evaluation.metrics.diversity import multimodality, shared_pairs_multimodality
from latentmotion.evaluation.observation import Observer
from latentmotion.evaluation.settings import Protocol
from latentmotion.evaluation.subject import Generated
from latentmotion.evaluation.trials import Trial


def asked_for(subject: Generated, protocol: Protocol, replication: int) -> bool:
    """Returns whether this replication measures it: of text alone, labels have many motions."""
    repeats = protocol.repeats
    wanted = repeats.texts > 0 and repeats.samples > 1
    return wanted and subject.card.condition.reads_text and replication < repeats.replications


def repeated_multimodality(
    subject: Generated, trial: Trial, observer: Observer, protocol: Protocol
) -> float:
    """Generates the motions and returns their MultiModality."""
    repeats, replication = protocol.repeats, trial.replication
    generator = protocol.generator("repeats", replication)
    count = min(repeats.texts, len(trial.questions))
    chosen = generator.choice(len(trial.questions), count, replace=False)
    questions = [trial.questions[row] for row in chosen for _ in range(repeats.samples)]
    seeds = [
        seed
        for row in chosen
        for seed in protocol.seeds("repeats", replication, repeats.samples, int(row))
    ]
    motions = subject.answer(questions, seeds)
    seen = observer.vectors(motions).reshape(count, repeats.samples, -1)
    if repeats.pairs is None:
        return multimodality(list(seen))
    pairs = min(repeats.pairs, repeats.samples)
    one, other = (generator.choice(repeats.samples, pairs, replace=False) for _ in range(2))
    return shared_pairs_multimodality(np.asarray(seen), one, other)
