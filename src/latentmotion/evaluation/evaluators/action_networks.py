"""Networks that recognize actions: Action2Motion's GRU, ACTOR's ST-GCN, and our own.

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
run. Here it is zero, and `DrawnState` draws it for the protocol `paper`.

Their joints are those of SMPL's neutral body. Without its file a free skeleton stands in; see
`evaluation/position_scores.py`.

    rotations of 24 joints (6 numbers each) → batch norm → 10 blocks → mean over frames and joints
    (256), which FID compares → 40 logits

One block (Yan et al., "Spatial temporal graph convolutional networks", AAAI 2018, eq. 10):

    y[t, w] = Σ_k Σ_v (W_k x[t, v] + b_k) · A_k[v, w] · E_k[v, w]      over the graph
    out = ReLU(BN(conv over 9 frames of ReLU(BN(y))) + residual)       over time

A_k splits each joint's neighborhood in three: itself, the joints not nearer to the root, and those
nearer; E is learned in every block. Names are those of ACTOR's `uestc_rot6d_stgcn.tar`.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn

from latentmotion.networks.vae.convolutional import MaskedConvolution, ResidualBlock


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

    features: int = 263
    """Numbers per frame; taken from the data in training."""
    labels: int = 0
    """Actions; taken from the data in training."""
    channels: int = 96
    """Channels of the convolutions."""
    dilations: tuple[int, ...] = (1, 3, 9)
    """Dilation of each residual block."""
    width: int = 30
    """Width of the last hidden layer, as in the authors' classifier of HumanAct12."""
    dropout: float = 0.2
    """Part of the channels that is dropped in training."""

    def build(self) -> TemporalClassifier:
        """Builds the network with fresh weights."""
        return TemporalClassifier(self)


class TemporalClassifier(ActionNetwork):
    """The classifier."""

    def __init__(self, config: TemporalClassifierConfig) -> None:
        super().__init__()
        self.entry = MaskedConvolution(config.features, config.channels, 3)
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

    joints: int = 24
    """Joints a frame."""
    labels: int = 12
    """Actions."""
    hidden: int = 128
    """Width of the GRU."""
    layers: int = 2
    """Its layers."""
    width: int = 30
    """Width of the last hidden layer."""

    def build(self) -> MotionGRU:
        """Builds the network with fresh weights."""
        return MotionGRU(self)


class MotionGRU(ActionNetwork):
    """The classifier; its names are those of the authors' file."""

    published = True
    sees_joints = True

    def __init__(self, config: MotionGRUConfig) -> None:
        super().__init__()
        inputs = config.joints * 3
        self.recurrent = nn.GRU(inputs, config.hidden, config.layers, batch_first=True)
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


class DrawnState(ActionNetwork):
    """A `MotionGRU` that starts from a normal random state in every call, as the authors' does."""

    def __init__(self, network: MotionGRU, noise: np.random.Generator) -> None:
        super().__init__()
        self.network, self._noise = network, noise

    def features(
        self, motions: Float[Tensor, "batch frames joints 3"]
    ) -> Float[Tensor, "batch width"]:
        """Returns the last hidden layer."""
        layers = self.network.recurrent
        shape = layers.num_layers, len(motions), layers.hidden_size
        drawn = torch.from_numpy(self._noise.standard_normal(shape, dtype=np.float32))
        return self.network.features(motions, drawn.to(motions.device))

    def classify(self, features: Float[Tensor, "batch width"]) -> Float[Tensor, "batch labels"]:
        """Returns the logits."""
        return self.network.classify(features)


SMPL_PARENTS = (
    *(-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8),
    *(9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21),
)
"""Parents of SMPL's 24 joints: HumanML3D's 22 and the hands."""


@dataclass(frozen=True)
class GraphNetworkConfig:
    """Sizes of a `GraphNetwork`."""

    labels: int = 40
    """Actions."""
    channels: int = 6
    """Numbers per joint."""
    parents: tuple[int, ...] = SMPL_PARENTS
    """The skeleton."""
    widths: tuple[int, ...] = (64, 64, 64, 64, 128, 128, 128, 256, 256, 256)
    """Channels after each block; the frame rate is halved where they grow."""
    kernel: int = 9
    """Frames that a block's convolution over time sees."""

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
        if not residual:
            self.residual: nn.Module = Nothing()
        elif inputs == outputs and stride == 1:
            self.residual = nn.Identity()
        else:
            convolution = nn.Conv2d(inputs, outputs, kernel_size=1, stride=(stride, 1))
            self.residual = nn.Sequential(convolution, nn.BatchNorm2d(outputs))

    def forward(
        self, x: Float[Tensor, "batch _ frames joints"], adjacency: Float[Tensor, "3 joints joints"]
    ) -> Float[Tensor, "batch channels fewer_frames joints"]:
        """Returns (batch, outputs, frames / stride, joints)."""
        return torch.relu(self.tcn(self.gcn(x, adjacency)) + self.residual(x))


class GraphConvolution(nn.Module):
    """A linear layer per neighborhood, and the sum over it."""

    def __init__(self, inputs: int, outputs: int, neighborhoods: int = 3) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs * neighborhoods, kernel_size=1)

    def forward(
        self, x: Float[Tensor, "batch _ frames joints"], adjacency: Float[Tensor, "3 joints joints"]
    ) -> Float[Tensor, "batch channels frames joints"]:
        """Returns what every joint gathers."""
        parts = self.conv(x).unflatten(1, (len(adjacency), -1))
        return torch.einsum("nkctv,kvw->nctw", parts, adjacency)


class Nothing(nn.Module):
    """The first block's residual path."""

    def forward(self, x: Tensor) -> float:
        """Returns zero."""
        return 0.0


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
