"""UESTC's classifier, the spatial-temporal graph network that ACTOR trained: 40 actions.

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
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from latentmotion.evaluation.evaluators.action_network import ActionNetwork

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
