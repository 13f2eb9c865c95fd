"""Action classifiers as folders: `evaluator.json` says which network and labels, and how it looks.

Three networks can be in one: HumanAct12's GRU, UESTC's graph network, and our own.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from safetensors.torch import save_file
from torch import Tensor

from latentmotion.checkpoint import load_weights, read_weights
from latentmotion.errors import InputError, ModelError
from latentmotion.evaluation.extractors.action_network import (
    ActionNetwork,
    Preparation,
    Recognizer,
)
from latentmotion.evaluation.extractors.gru import MotionGRUConfig
from latentmotion.evaluation.extractors.interface import EVALUATOR_FILE, WEIGHTS_FILE
from latentmotion.evaluation.extractors.stgcn import GraphNetworkConfig
from latentmotion.evaluation.extractors.temporal import TemporalClassifierConfig
from latentmotion.representation.interface import representation_named
from latentmotion.representation.normalizer import Normalizer
from latentmotion.representation.smpl import SmplRepresentation
from latentmotion.storage.configuration import read_json, to_json
from latentmotion.storage.files import atomic_folder, sha256

ROTATION_CHANNELS = 6
"""Numbers per joint of the representation "smpl", whose index is channel · 25 + joint."""


@dataclass(frozen=True)
class ActionClassifier:
    """What `evaluator.json` says of an action classifier."""

    labels: tuple[str, ...]
    """The labels, in the order of the logits."""
    representation: str
    """Which features it takes."""
    network: MotionGRUConfig | GraphNetworkConfig | TemporalClassifierConfig
    """Which network it is."""
    mean: tuple[float, ...] = ()
    """What features are normalized by; only our own network sees normalized features."""
    std: tuple[float, ...] = ()
    """What features are normalized by."""
    origin: str = ""
    """What it was trained on, or the file it comes from."""
    license: str = ""
    """Terms of its weights."""
    figures: dict[str, float] = field(default_factory=dict)
    """Accuracies by split."""


def save_action_classifier(
    folder: str | Path, about: ActionClassifier, weights: Mapping[str, Tensor]
) -> None:
    """Writes an evaluator folder in place of what is there, or nothing at all.

    Raises:
        ModelError: The weights are not those of the network.
        InputError: The folder cannot be written.
    """
    load_weights(about.network.build(), dict(weights), "weights")
    with atomic_folder(folder, EVALUATOR_FILE) as temporary:
        text = json.dumps({**to_json(about), "kind": "action"}, indent=1)
        (temporary / EVALUATOR_FILE).write_text(text + "\n", encoding="utf-8")
        kept = {key: tensor.detach().cpu().contiguous() for key, tensor in weights.items()}
        save_file(kept, temporary / WEIGHTS_FILE)


def load_action_classifier(folder: str | Path) -> Recognizer:
    """Reads an evaluator folder that holds an action classifier.

    Raises:
        ModelError: Something is missing, damaged, or does not fit the rest.
    """
    folder = Path(folder)
    about = describe_action_classifier(folder)
    network = about.network.build()
    path = folder / WEIGHTS_FILE
    load_weights(network, read_weights(path), str(path))
    return recognizer_of(about, network.requires_grad_(False), _fingerprint(folder))


def describe_action_classifier(folder: str | Path) -> ActionClassifier:
    """Reads what `evaluator.json` says.

    Raises:
        ModelError: It is missing, damaged, or contradicts itself.
    """
    try:
        about = read_json(ActionClassifier, Path(folder) / EVALUATOR_FILE)
    except InputError as error:
        raise ModelError(f"{error}; make the evaluator again") from error
    if len(about.labels) != about.network.labels:
        raise ModelError(
            f"{folder}: {len(about.labels)} labels for a network of {about.network.labels}; "
            "make the evaluator again"
        )
    return about


def recognizer_of(about: ActionClassifier, network: ActionNetwork, fingerprint: str) -> Recognizer:
    """Returns the extractor around a network."""
    width = representation_named(about.representation).width
    return Recognizer(about.labels, fingerprint, network.eval(), _preparation(about), width)


def _preparation(about: ActionClassifier) -> Preparation:
    if isinstance(about.network, GraphNetworkConfig):
        return rotations_of
    if isinstance(about.network, MotionGRUConfig):
        part = representation_named(about.representation)
        # HumanAct12's classifier looks at joints in the axes of its data, not at upright ones.
        return part.camera_joints if isinstance(part, SmplRepresentation) else part.decode
    mean, std = (np.array(values, np.float32) for values in (about.mean, about.std))
    return Normalizer(mean, std).normalize


def rotations_of(features: np.ndarray) -> np.ndarray:
    """Returns (frames, 24 joints, 6) of the features "smpl"; the translation is left out."""
    by_channel = features.reshape(len(features), ROTATION_CHANNELS, -1)
    return by_channel[:, :, :-1].transpose(0, 2, 1)


def _fingerprint(folder: Path) -> str:
    both = "".join(sha256(folder / name) for name in (EVALUATOR_FILE, WEIGHTS_FILE))
    return hashlib.sha256(both.encode()).hexdigest()
