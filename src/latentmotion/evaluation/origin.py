"""What a report was made from: hashes, names and versions."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from latentmotion.data.dataset import Dataset
from latentmotion.evaluation.bodies import body_of
from latentmotion.evaluation.observation import Extractor
from latentmotion.evaluation.report import Provenance
from latentmotion.evaluation.subject import Generated, Subject
from latentmotion.model.card import ModelCard
from latentmotion.runtime.device import describe_machine
from latentmotion.storage.files import sha256
from latentmotion.storage.provenance import commit

_WEIGHTS = ("*.safetensors", "*.onnx", "tokenizer.json")


def provenance_of(
    subjects: Sequence[Subject], dataset: Dataset, extractor: Extractor | None
) -> Provenance:
    """Says what a report is made from."""
    return Provenance(
        data=dataset.folder.name,
        data_hash=dataset.fingerprint,
        weights={subject.row: subject.weights for subject in subjects},
        statistics={subject.row: statistics_hash(subject.card) for subject in subjects},
        models={subject.row: subject.card.name for subject in subjects},
        sampling={subject.row: _sampling(subject) for subject in subjects},
        evaluator="" if extractor is None else extractor.fingerprint,
        body=body_of(dataset),
        versions=_versions(),
    )


def weights_hash(folder: str | Path) -> str:
    """Returns one hash of all files of a model folder that hold weights."""
    files = sorted({path for pattern in _WEIGHTS for path in Path(folder).glob(pattern)})
    lines = (f"{sha256(path)} {path.name}\n" for path in files)
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def statistics_hash(card: ModelCard) -> str:
    """Returns a hash of the mean and deviation by which a model normalizes."""
    values = np.array([card.normalizer_mean, card.normalizer_std], np.float32)
    return hashlib.sha256(values.tobytes()).hexdigest()


def official(extractor: Extractor | None) -> bool:
    """Returns whether an evaluator is one that papers use: a file of its authors, converted."""
    return bool(getattr(extractor, "official", False))


def _sampling(subject: Subject) -> str:
    if not isinstance(subject, Generated):
        return ""
    card = subject.card
    sampling = subject.sampling or card.sampling
    return f", {sampling.sampler} {sampling.steps} steps, guidance {sampling.guidance:g}"


def _versions() -> dict[str, str]:
    packages = {name: version(name) for name in ("latentmotion", "numpy", "scipy", "torch")}
    return {**packages, "commit": commit() or "unknown", "machine": describe_machine()}
