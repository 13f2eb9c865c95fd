"""HumanAct12's classifier, the GRU of Action2Motion: joints over time → 12 actions.

    24 joints × 3 (72) → two GRU layers (128), output at the last frame → tanh of a linear layer
    (30), which FID compares → 12 logits

The authors draw the GRU's first state at random in every call, so their figures differ from run to
run. Here it is zero, and `DrawnState` draws it for the protocol `paper`.

Their joints are those of SMPL's neutral body. Without its file a free skeleton stands in; see
`evaluation/smpl_joints.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from latentmotion.evaluation.evaluators.action_network import ActionNetwork

HUMANACT12_LABELS = (
    *("warm_up", "walk", "run", "jump", "drink", "lift_dumbbell", "sit", "eat"),
    *("turn steering wheel", "phone", "boxing", "throw"),
)
"""Labels in the order of the authors' logits."""


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
