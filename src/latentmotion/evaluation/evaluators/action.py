"""Action classifiers: recognition of motions, and evaluator folders.

`evaluator.json` names the network, its labels and its normalizer. The network is HumanAct12's GRU,
UESTC's graph network, or our own. Motions of one length go through it together, so that it never
sees padding and each motion is judged as it would be alone.

Networks that recognize actions: Action2Motion's GRU, ACTOR's ST-GCN, and our own.

    input of a motion → features (width), which FID compares → logits (labels)

Our own is a small convolution network over time:

    normalized features (T, features) → dilated convolutions (T, channels) → mean and peak over the
    frames → linear layer (width), which FID compares → SiLU → logits

FID compares values before the last activation: after a tanh, as in HumanAct12's classifier, they
would hardly tell more than the class. Padding is set to zero after every convolution and left out
of mean and peak, so that it cannot leak.

    24 joints × 3 (72) → two GRU layers (128), output at the last frame → tanh of a linear layer
    (30), which FID compares → 12 logits

The authors draw the GRU's first state at random in every call, so their figures differ from run to
run. Here it is zero, and the protocol `paper` draws it.

Their joints are those of SMPL's neutral body. Without its file a free skeleton stands in; see
`evaluation/scores.py`.

    rotations of 24 joints (6 numbers each) → batch norm → 10 blocks → mean over frames and joints
    (256), which FID compares → 40 logits

One block (Yan et al., "Spatial temporal graph convolutional networks", AAAI 2018, eq. 10):

    y[t, w] = Σ_k Σ_v (W_k x[t, v] + b_k) · A_k[v, w] · E_k[v, w]      over the graph
    out = ReLU(BN(conv over 9 frames of ReLU(BN(y))) + residual)       over time

A_k splits each joint's neighborhood in three: itself, the joints not nearer to the root, and those
nearer; E is learned in every block. Names are those of ACTOR's `uestc_rot6d_stgcn.tar`.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from safetensors.torch import save_file
from torch import Tensor, nn

from latentmotion.errors import InputError, ModelError
from latentmotion.evaluation.evaluators.interface import EVALUATOR_FILE, WEIGHTS_FILE, Recognition
from latentmotion.networks.checkpoint import load_weights, read_weights
from latentmotion.networks.vae.convolutional import MaskedConvolution, ResidualBlock
from latentmotion.representation import representation_named
from latentmotion.representation.interface import Normalizer
from latentmotion.representation.smpl import SmplRepresentation
from latentmotion.storage.configuration import read_json, to_json
from latentmotion.storage.files import atomic_folder, sha256


class ActionNetwork(nn.Module, ABC):
    """A classifier in two halves, whose last hidden layer is its embedding.

    Attributes:
        published: Whether papers use it with its authors' weights.
        sees_joints: Whether its input is joints, so that the body matters.
    """

    published: ClassVar[bool] = False
    sees_joints: ClassVar[bool] = False

    @abstractmethod
    def features(self, motions: Float[Tensor, "batch frames *inputs"]) -> Tensor:
        """Returns the last hidden layer (batch, width) of motions of one length."""

    @abstractmethod
    def classify(self, features: Float[Tensor, "batch width"]) -> Tensor:
        """Returns the logits (batch, labels) of what `features` returned."""


@dataclass(frozen=True)
class TemporalClassifierConfig:
    """Sizes of a `TemporalClassifier`."""

    features: int = 263  # Numbers per frame; taken from the data in training.
    labels: int = 0  # Actions; taken from the data in training.
    channels: int = 96  # Channels of the convolutions.
    dilations: tuple[int, ...] = (1, 3, 9)  # Dilation of each residual block.
    width: int = 30  # Width of the last hidden layer, as in the authors' classifier of HumanAct12.
    dropout: float = 0.2  # Part of the channels that is dropped in training.

    def build(self) -> TemporalClassifier:
        """Builds the network with fresh weights."""
        return TemporalClassifier(self)


class TemporalClassifier(ActionNetwork):
    """The classifier."""

    def __init__(self, config: TemporalClassifierConfig) -> None:
        super().__init__()
        self.entry = MaskedConvolution(config.features, config.channels)
        self.blocks = nn.ModuleList(ResidualBlock(config.channels, d) for d in config.dilations)
        self.hidden = nn.Linear(2 * config.channels, config.width)
        self.head = nn.Linear(config.width, config.labels)
        self.dropout = nn.Dropout(config.dropout)

    def features(
        self,
        motions: Float[Tensor, "batch frames features"],
        mask: Bool[Tensor, "batch frames"] | None = None,
    ) -> Float[Tensor, "batch width"]:
        """Returns the last hidden layer; without a mask all frames are real."""
        mask = mask if mask is not None else motions.new_ones(motions.shape[:2], dtype=torch.bool)
        row = mask[:, None].float()
        x = self.entry(motions.transpose(1, 2) * row, row)
        for block in self.blocks:
            x = block(self.dropout(x), row)
        mean = x.sum(dim=2) / row.sum(dim=2)
        peak = x.masked_fill(row == 0, -math.inf).amax(dim=2)
        return self.hidden(self.dropout(torch.cat([mean, peak], dim=1)))

    def classify(self, features: Float[Tensor, "batch width"]) -> Float[Tensor, "batch labels"]:
        """Returns the logits."""
        return self.head(self.dropout(F.silu(features)))


@dataclass(frozen=True)
class MotionGRUConfig:
    """Sizes of a `MotionGRU`."""

    joints: int = 24  # Joints a frame.
    labels: int = 12  # Actions.
    hidden: int = 128  # Width of the GRU.
    layers: int = 2  # Its layers.
    width: int = 30  # Width of the last hidden layer.

    def build(self) -> MotionGRU:
        """Builds the network with fresh weights."""
        return MotionGRU(self)


class MotionGRU(ActionNetwork):
    """The classifier; its names are those of the authors' file."""

    published = True
    sees_joints = True

    def __init__(self, config: MotionGRUConfig) -> None:
        super().__init__()
        self.recurrent = nn.GRU(config.joints * 3, config.hidden, config.layers, batch_first=True)
        self.linear1 = nn.Linear(config.hidden, config.width)
        self.linear2 = nn.Linear(config.width, config.labels)

    def features(
        self,
        motions: Float[Tensor, "batch frames joints 3"],
        state: Float[Tensor, "layers batch hidden"] | None = None,
    ) -> Float[Tensor, "batch width"]:
        """Returns the last hidden layer; the GRU starts from `state`, or from zero."""
        outputs, _ = self.recurrent(motions.flatten(2), state)
        return torch.tanh(self.linear1(outputs[:, -1]))

    def classify(self, features: Float[Tensor, "batch width"]) -> Float[Tensor, "batch labels"]:
        """Returns the logits."""
        return self.linear2(features)


# Parents of SMPL's 24 joints: HumanML3D's 22 and the hands.
SMPL_PARENTS = (
    *(-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8),
    *(9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21),
)


@dataclass(frozen=True)
class GraphNetworkConfig:
    """Sizes of a `GraphNetwork`."""

    labels: int = 40  # Actions.
    channels: int = 6  # Numbers per joint.
    parents: tuple[int, ...] = SMPL_PARENTS  # The skeleton.
    # Channels after each block; the frame rate is halved where they grow.
    widths: tuple[int, ...] = (64, 64, 64, 64, 128, 128, 128, 256, 256, 256)
    kernel: int = 9  # Frames that a block's convolution over time sees.

    def build(self) -> GraphNetwork:
        """Builds the network with fresh weights."""
        return GraphNetwork(self)


class GraphNetwork(ActionNetwork):
    """The classifier."""

    published = True

    A: Tensor

    def __init__(self, config: GraphNetworkConfig) -> None:
        super().__init__()
        widths = config.widths
        adjacency = torch.from_numpy(neighborhoods(config.parents)).float()
        self.register_buffer("A", adjacency)
        self.data_bn = nn.BatchNorm1d(len(config.parents) * config.channels)
        first = GraphBlock(config.channels, widths[0], config.kernel, 1, residual=False)
        pairs = itertools.pairwise(widths)
        others = (GraphBlock(a, b, config.kernel, 1 + (b > a)) for a, b in pairs)
        self.st_gcn_networks = nn.ModuleList([first, *others])
        self.edge_importance = nn.ParameterList(torch.ones_like(adjacency) for _ in widths)
        self.fcn = nn.Conv2d(widths[-1], config.labels, kernel_size=1)

    def features(
        self, motions: Float[Tensor, "batch frames joints channels"]
    ) -> Float[Tensor, "batch width"]:
        """Returns the mean of the last block over frames and joints."""
        x = self.data_bn(motions.flatten(2).transpose(1, 2)).transpose(1, 2)
        x = x.reshape(motions.shape).permute(0, 3, 1, 2)
        for block, importance in zip(self.st_gcn_networks, self.edge_importance, strict=True):
            x = block(x, self.A * importance)
        return x.mean(dim=(2, 3))

    def classify(self, features: Float[Tensor, "batch width"]) -> Float[Tensor, "batch labels"]:
        """Returns the logits."""
        return self.fcn(features[..., None, None])[..., 0, 0]


class GraphBlock(nn.Module):
    """A convolution over the graph, then one over time, beside a residual path."""

    def __init__(
        self, inputs: int, outputs: int, kernel: int, stride: int, residual: bool = True
    ) -> None:
        super().__init__()
        self.gcn = GraphConvolution(inputs, outputs)
        self.tcn = nn.Sequential(
            nn.BatchNorm2d(outputs),
            nn.ReLU(),
            nn.Conv2d(outputs, outputs, (kernel, 1), (stride, 1), (kernel // 2, 0)),
            nn.BatchNorm2d(outputs),
        )
        convolution = nn.Conv2d(inputs, outputs, kernel_size=1, stride=(stride, 1))
        same = nn.Identity() if inputs == outputs and stride == 1 else None
        through = same or nn.Sequential(convolution, nn.BatchNorm2d(outputs))
        self.residual = through if residual else None

    def forward(
        self, x: Float[Tensor, "batch _ frames joints"], adjacency: Float[Tensor, "3 joints joints"]
    ) -> Float[Tensor, "batch channels fewer_frames joints"]:
        """Returns (batch, outputs, frames / stride, joints)."""
        beside = 0.0 if self.residual is None else self.residual(x)
        return torch.relu(self.tcn(self.gcn(x, adjacency)) + beside)


class GraphConvolution(nn.Module):
    """A linear layer per neighborhood, and the sum over it."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, 3 * outputs, kernel_size=1)  # of the three neighborhoods

    def forward(
        self, x: Float[Tensor, "batch _ frames joints"], adjacency: Float[Tensor, "3 joints joints"]
    ) -> Float[Tensor, "batch channels frames joints"]:
        """Returns what every joint gathers."""
        parts = self.conv(x).unflatten(1, (len(adjacency), -1))
        return torch.einsum("nkctv,kvw->nctw", parts, adjacency)


def neighborhoods(parents: Sequence[int]) -> Float[np.ndarray, "3 joints joints"]:
    """Returns A: itself; neighbors not nearer to the root; neighbors nearer; columns sum to 1.

    A quirk of the original is kept: it knows distances to the root up to one bone, and all farther
    joints count as equally far; so below the root's grandchildren parents are not "nearer".
    """
    joints = len(parents)
    bones = np.zeros((joints, joints))
    for child, parent in enumerate(parents):
        if parent >= 0:
            bones[child, parent] = bones[parent, child] = 1
    share = (bones + np.eye(joints)) / (bones.sum(axis=0) + 1)
    to_root = np.where(bones[0] > 0, 1, 2)
    to_root[0] = 0
    nearer = (to_root[:, None] < to_root[None]) & (bones > 0)
    beside = ~nearer & (bones > 0)
    return np.stack([share * part for part in (np.eye(joints), beside, nearer)])


MAX_BATCH_SIZE = 64  # Most motions that go through a network at once.

# Numbers per joint of the representation "smpl", whose index is channel · 25 + joint.
ROTATION_CHANNELS = 6

# Features (frames, features) in their own units to the input of a network, frames first.
Preparation = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Recognizer:
    """An `ActionEvaluator`: a network, and the preparation of its input."""

    labels: tuple[str, ...]  # Labels in the order of the logits.
    fingerprint: str  # Hash of weights and description.
    network: ActionNetwork  # The classifier, in `eval()` mode.
    prepare: Preparation  # Features to the network's input.
    width: int  # Features per frame that `prepare` takes.
    # Draws the first state of a GRU in every call, as the authors do; None for zeros.
    noise: np.random.Generator | None = None

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
        network, device = self.network, next(self.network.parameters()).device
        motions, drawn = torch.from_numpy(prepared).float().to(device), {}
        if self.noise is not None and isinstance(network, MotionGRU):
            shape = network.recurrent.num_layers, len(motions), network.recurrent.hidden_size
            state = self.noise.standard_normal(shape, dtype=np.float32)
            drawn["state"] = torch.from_numpy(state).to(device)
        hidden = network.features(motions, **drawn)
        return hidden.cpu().numpy(), network.classify(hidden).cpu().numpy()


@dataclass(frozen=True)
class ActionClassifier:
    """Content of the `evaluator.json` of an action classifier."""

    labels: tuple[str, ...]  # Labels in the order of the logits.
    representation: str  # Name of the motion features.
    # Kind and sizes of the network.
    network: MotionGRUConfig | GraphNetworkConfig | TemporalClassifierConfig
    # Mean of the features; only our own network takes normalized ones.
    mean: tuple[float, ...] = ()
    std: tuple[float, ...] = ()  # Standard deviation of the features.
    origin: str = ""  # Training data, or the file that it was converted from.
    license: str = ""  # License of its weights.
    figures: dict[str, float] = field(default_factory=dict)  # Accuracies by split.


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
    return features.reshape(len(features), ROTATION_CHANNELS, -1)[:, :, :-1].transpose(0, 2, 1)
