"""Networks that recognize actions: the interface of all, and our own for any labelled data set.

    input of a motion → features (width), which FID compares → logits (labels)

Our own is a small convolution network over time:

    normalized features (T, features) → dilated convolutions (T, channels) → mean and peak over the
    frames → linear layer (width), which FID compares → SiLU → logits

FID compares values before the last activation: after a tanh, as in HumanAct12's classifier, they
would hardly tell more than the class. Padding is set to zero after every convolution and left out
of mean and peak, so that it cannot leak.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

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
