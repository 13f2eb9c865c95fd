"""Provenance of a report: hashes, names and versions."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from latentmotion.data.dataset import Dataset
from latentmotion.evaluation.candidates import Candidate, Generated
from latentmotion.evaluation.evaluators.interface import Evaluator
from latentmotion.evaluation.report import Provenance
from latentmotion.evaluation.smpl_joints import body_of
from latentmotion.gpu.device import describe_machine
from latentmotion.model.card import ModelCard
from latentmotion.storage.files import sha256
from latentmotion.storage.provenance import commit

_WEIGHTS = ("*.safetensors", "*.onnx", "tokenizer.json")


def provenance_of(
    candidates: Sequence[Candidate], dataset: Dataset, evaluator: Evaluator | None
) -> Provenance:
    """Returns the provenance of a report."""
    sampling = dict.fromkeys((candidate.row for candidate in candidates), "")
    for candidate in candidates:
        if isinstance(candidate, Generated):
            used = candidate.sampling or candidate.card.sampling
            sampling[candidate.row] = (
                f", {used.sampler} {used.steps} steps, guidance {used.guidance:g}"
            )
    packages = {name: version(name) for name in ("latentmotion", "numpy", "scipy", "torch")}
    return Provenance(
        data=dataset.folder.name,
        data_hash=dataset.fingerprint,
        weights={candidate.row: candidate.weights for candidate in candidates},
        statistics={candidate.row: statistics_hash(candidate.card) for candidate in candidates},
        models={candidate.row: candidate.card.name for candidate in candidates},
        sampling=sampling,
        evaluator="" if evaluator is None else evaluator.fingerprint,
        body=body_of(dataset),
        versions={**packages, "commit": commit() or "unknown", "machine": describe_machine()},
    )


def weights_hash(folder: str | Path) -> str:
    """Returns one hash of all weight files of a model folder."""
    files = sorted({path for pattern in _WEIGHTS for path in Path(folder).glob(pattern)})
    lines = (f"{sha256(path)} {path.name}\n" for path in files)
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def statistics_hash(card: ModelCard) -> str:
    """Returns a hash of the mean and standard deviation of a model's normalizer."""
    values = np.array([card.normalizer_mean, card.normalizer_std], np.float32)
    return hashlib.sha256(values.tobytes()).hexdigest()
