"""Action classifiers: recognition of motions, and evaluator folders.

`evaluator.json` names the network, its labels and its normalizer. The network is HumanAct12's GRU,
UESTC's graph network, or our own. Motions of one length go through it together, so that it never
sees padding and each motion is judged as it would be alone.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from safetensors.torch import save_file
from torch import Tensor

from latentmotion.errors import InputError, ModelError
from latentmotion.evaluation.evaluators.action_networks import (
    ActionNetwork,
    DrawnState,
    GraphNetworkConfig,
    MotionGRU,
    MotionGRUConfig,
    TemporalClassifierConfig,
)
from latentmotion.evaluation.evaluators.interface import (
    EVALUATOR_FILE,
    WEIGHTS_FILE,
    Recognition,
)
from latentmotion.networks.checkpoint import load_weights, read_weights
from latentmotion.representation.interface import Normalizer, representation_named
from latentmotion.representation.smpl import SmplRepresentation
from latentmotion.storage.configuration import read_json, to_json
from latentmotion.storage.files import atomic_folder, sha256

MAX_BATCH_SIZE = 64
"""Most motions that go through a network at once."""

ROTATION_CHANNELS = 6
"""Numbers per joint of the representation "smpl", whose index is channel · 25 + joint."""

Preparation = Callable[[np.ndarray], np.ndarray]
"""Features (frames, features) in their own units to the input of a network, frames first."""


@dataclass(frozen=True, eq=False)
class Recognizer:
    """An `ActionEvaluator`: a network, and the preparation of its input."""

    labels: tuple[str, ...]
    """Labels in the order of the logits."""
    fingerprint: str
    """Hash of weights and description."""
    network: ActionNetwork
    """The classifier, in `eval()` mode."""
    prepare: Preparation
    """Features to the network's input."""
    width: int
    """Features per frame that `prepare` takes."""

    def __call__(self, features: Sequence[Float[np.ndarray, "_ _"]]) -> Recognition:
        """Recognizes motions, given in their own units; lengths may differ.

        Raises:
            InputError: There is no motion, an empty one, or one of another representation.
        """
        if not features:
            raise InputError("no motion to recognize; give at least one")
        by_length: dict[int, list[int]] = {}
        for row, motion in enumerate(features):
            if not len(motion) or motion.shape[-1] != self.width:
                raise InputError(
                    f"this action classifier takes motions of one frame or more with {self.width} "
                    f"features, found {motion.shape}; use the evaluator of this data set"
                )
            by_length.setdefault(len(motion), []).append(row)
        recognized: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        for same in by_length.values():
            for start in range(0, len(same), MAX_BATCH_SIZE):
                rows = same[start : start + MAX_BATCH_SIZE]
                hidden, logits = self.run(np.stack([self.prepare(features[row]) for row in rows]))
                recognized |= {row: (hidden[i], logits[i]) for i, row in enumerate(rows)}
        in_order = [recognized[row] for row in range(len(features))]
        return Recognition(*(np.stack(arrays) for arrays in zip(*in_order, strict=True)))

    @property
    def official(self) -> bool:
        """Whether the classifier's figures can be compared with those of papers."""
        return self.network.published

    @torch.no_grad()
    def run(
        self, prepared: Float[np.ndarray, "batch frames *inputs"]
    ) -> tuple[Float[np.ndarray, "batch width"], Float[np.ndarray, "batch labels"]]:
        """Returns last hidden layer and logits of motions of one length."""
        device = next(self.network.parameters()).device
        hidden = self.network.features(torch.from_numpy(prepared).float().to(device))
        return hidden.cpu().numpy(), self.network.classify(hidden).cpu().numpy()


def drawing_states(recognizer: Recognizer, noise: np.random.Generator) -> Recognizer:
    """Returns a recognizer with the authors' random first state, or as it is without a GRU."""
    if not isinstance(recognizer.network, MotionGRU):
        return recognizer
    return replace(recognizer, network=DrawnState(recognizer.network, noise).eval())


@dataclass(frozen=True)
class ActionClassifier:
    """Content of the `evaluator.json` of an action classifier."""

    labels: tuple[str, ...]
    """Labels in the order of the logits."""
    representation: str
    """Name of the motion features."""
    network: MotionGRUConfig | GraphNetworkConfig | TemporalClassifierConfig
    """Kind and sizes of the network."""
    mean: tuple[float, ...] = ()
    """Mean of the features; only our own network takes normalized ones."""
    std: tuple[float, ...] = ()
    """Standard deviation of the features."""
    origin: str = ""
    """Training data, or the file that it was converted from."""
    license: str = ""
    """License of its weights."""
    figures: dict[str, float] = field(default_factory=dict)
    """Accuracies by split."""


def save_action_classifier(
    folder: str | Path, description: ActionClassifier, weights: Mapping[str, Tensor]
) -> None:
    """Writes an evaluator folder in place of what is there, or nothing at all.

    Raises:
        ModelError: The weights are not those of the network.
        InputError: The folder cannot be written.
    """
    load_weights(description.network.build(), dict(weights), "weights")
    with atomic_folder(folder, EVALUATOR_FILE) as temporary:
        text = json.dumps({**to_json(description), "kind": "action"}, indent=1)
        (temporary / EVALUATOR_FILE).write_text(text + "\n", encoding="utf-8")
        tensors = {key: tensor.detach().cpu().contiguous() for key, tensor in weights.items()}
        save_file(tensors, temporary / WEIGHTS_FILE)


def load_action_classifier(folder: str | Path) -> Recognizer:
    """Reads an evaluator folder that holds an action classifier.

    Raises:
        ModelError: Something is missing, damaged, or does not fit the rest.
    """
    folder = Path(folder)
    description = describe_action_classifier(folder)
    network = description.network.build()
    path = folder / WEIGHTS_FILE
    load_weights(network, read_weights(path), str(path))
    hashes = "".join(sha256(folder / name) for name in (EVALUATOR_FILE, WEIGHTS_FILE))
    fingerprint = hashlib.sha256(hashes.encode()).hexdigest()
    return recognizer_of(description, network.requires_grad_(False), fingerprint)


def describe_action_classifier(folder: str | Path) -> ActionClassifier:
    """Reads `evaluator.json`.

    Raises:
        ModelError: It is missing, damaged, or contradicts itself.
    """
    try:
        card = read_json(ActionClassifier, Path(folder) / EVALUATOR_FILE)
    except InputError as error:
        raise ModelError(f"{error}; make the evaluator again") from error
    if len(card.labels) != card.network.labels:
        raise ModelError(
            f"{folder}: {len(card.labels)} labels for a network of {card.network.labels}; "
            "make the evaluator again"
        )
    return card


def recognizer_of(
    description: ActionClassifier, network: ActionNetwork, fingerprint: str
) -> Recognizer:
    """Returns the evaluator around a network."""
    representation = representation_named(description.representation)
    if isinstance(description.network, GraphNetworkConfig):
        prepare: Preparation = rotations_of
    elif isinstance(description.network, MotionGRUConfig):
        # HumanAct12's classifier sees joints in the axes of its data, not upright ones.
        smpl = isinstance(representation, SmplRepresentation)
        prepare = representation.camera_joints if smpl else representation.decode
    else:
        mean, std = (np.array(values, np.float32) for values in (description.mean, description.std))
        prepare = Normalizer(mean, std).normalize
    return Recognizer(
        description.labels, fingerprint, network.eval(), prepare, representation.width
    )


def rotations_of(features: np.ndarray) -> np.ndarray:
    """Returns (frames, 24 joints, 6) of the features "smpl"; the translation is left out."""
    by_channel = features.reshape(len(features), ROTATION_CHANNELS, -1)
    return by_channel[:, :, :-1].transpose(0, 2, 1)
