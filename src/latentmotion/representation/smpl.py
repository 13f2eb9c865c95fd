"""SMPL's pose parameters as ACTOR feeds them to networks: 150 numbers a frame.

    25 tokens   24 joint rotations, 6D as the first two rows of the matrix, and
                the root trajectory since the first frame: x, y, z, 0, 0, 0
    150         number = 25 channel + token, channel 0 .. 5

Rotations are relative to the parent, from a T-pose that faces +z, y up. The root's is in the axes
of the camera that the data sets were filmed with: x to its right, y down, z away from it. Joints
come out upright: (x, -y, -z), so that a body that faces the camera faces +z.
Petrovich et al., "Action-Conditioned 3D Human Motion Synthesis with Transformer VAE", ICCV 2021.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import array_namespace, device
from latentmotion.kinematics import skeleton
from latentmotion.kinematics.inverse_kinematics import solve
from latentmotion.kinematics.rotations import matrix_from_sixd, sixd_from_matrix
from latentmotion.kinematics.smpl import SmplModel
from latentmotion.representation import canonical
from latentmotion.representation.interface import AnyJoints, Features, Positions, Representation

TOKENS = 25  # 24 joint rotations, and the root trajectory.

# Signs from the camera's axes to upright ones and back: half a turn about x.
UPRIGHT = (1.0, -1.0, -1.0)

# Entries of a rotation's first two rows; the root trajectory shares the first three.
_CHANNELS = ("xx", "xy", "xz", "yx", "yy", "yz")


@dataclass(frozen=True, eq=False)
class SmplRepresentation(Representation):
    """Joints to SMPL's pose features and back, by a skeleton of fixed bone lengths."""

    leg: tuple[int, ...] = (4, 7)  # Joints whose bones make up the length of a leg.
    # Hash of the SMPL model file with these bones; empty for the skeleton that ships.
    body: str = ""

    normalized = False

    @property
    def blocks(self) -> Mapping[str, slice]:
        """One block per channel of the tokens."""
        return {name: slice(i * TOKENS, (i + 1) * TOKENS) for i, name in enumerate(_CHANNELS)}

    def retarget(self, joints: Float[Any, "frames _ 3"]) -> AnyJoints:
        """Retargets another body to the skeleton; its path is scaled by the ratio of the legs.

        Limbs keep their directions; hips and shoulders sit where the skeleton has them. A body
        without hands gets them, in line with its forearms.
        """
        xp = array_namespace(joints)
        body = np.asarray(joints, dtype=np.float64)
        if body.shape[1] == len(self.skeleton) - 2:
            body = np.concatenate([body, (4 * body[:, 20:22] - body[:, 18:20]) / 3], axis=1)
        self.check(body)
        scale = self._leg_length(self.skeleton.rest_joints()) / self._leg_length(body[0])
        rotations = canonical.rotations_from(self.skeleton, solve(body, self.fps, self.skeleton))
        retargeted = self.skeleton.forward_kinematics(rotations, scale * body[:, 0])
        return xp.asarray(retargeted, device=device(joints))

    def encode(self, joints: AnyJoints) -> Float[Any, "frames_less_one features"]:
        """Finds rotations that reach the joints, of a body that first faces the camera.

        Args:
            joints: Global positions of at least two frames, meters, y up, of the skeleton; call
                `retarget` first for another body. The twist of hands, head and toes is not known.

        Returns:
            Features in float32, one row less than frames, as those with velocities.

        Raises:
            InputError: The joints do not fit the skeleton, are too few or not finite.
        """
        xp = array_namespace(joints)
        positions = np.asarray(joints, dtype=np.float64)
        self.check(positions)
        positions = canonical.canonicalize(positions, self.skeleton)
        rotations = canonical.rotations_from(
            self.skeleton, solve(positions, self.fps, self.skeleton)
        )
        rotations[:, 0] = np.array(UPRIGHT)[:, None] * rotations[:, 0]
        trajectory = (positions[:, 0] - positions[0, 0]) * UPRIGHT
        return xp.asarray(smpl_features(rotations, trajectory)[:-1], device=device(joints))

    def decode(self, features: Features) -> Positions:
        """Poses the skeleton; the clip starts above the origin, at the height of standing."""
        xp = array_namespace(features)
        signs = xp.asarray(UPRIGHT, dtype=features.dtype, device=device(features))
        height = -float(self.skeleton.rest_joints()[:, 1].min())  # of the pelvis above the soles
        start = xp.asarray([0.0, height, 0.0], dtype=features.dtype, device=device(features))
        return self.camera_joints(features) * signs + start

    def camera_joints(self, features: Features) -> Positions:
        """Returns joints in the axes of the data, the root at zero in the first frame.

        These are what HumanAct12's classifier looks at.
        """
        rotations, root = self.pose(features)
        return self.skeleton.forward_kinematics(rotations, root - root[..., :1, :])

    def pose(
        self, features: Features
    ) -> tuple[Float[Any, "*batch frames 24 3 3"], Float[Any, "*batch frames 3"]]:
        """Returns the rotations of the joints and the root trajectory, in the axes of the data.

        Features of zero, as on padding, are the identity.
        """
        xp = array_namespace(features)
        tokens = xp.reshape(features, (*features.shape[:-1], 6, TOKENS))
        tokens = xp.moveaxis(tokens, -2, -1)
        sixd, root = tokens[..., :-1, :], tokens[..., -1, :3]
        still = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
        identity = xp.asarray(still, dtype=features.dtype, device=device(features))
        blank = xp.sum(sixd * sixd, axis=-1, keepdims=True) < 1e-12
        return matrix_from_sixd(xp.where(blank, identity, sixd), "rows"), root

    def restart(self, features: Features) -> Features:
        """Moves the start of the root trajectory to zero."""
        xp = array_namespace(features)
        tokens = np.zeros((6, TOKENS), bool)
        tokens[:3, -1] = True
        of_root = xp.asarray(tokens.ravel(), device=device(features))
        return xp.where(of_root, features - features[..., :1, :], features)

    @cached_property
    def _mirror_map(self) -> tuple[list[int], Float[np.ndarray, " features"]]:
        """The feature that each one comes from, and its sign."""
        sources = np.arange(self.width).reshape(6, TOKENS)[:, [*self.skeleton.mirror, TOKENS - 1]]
        signs = np.repeat([[1, -1, -1, -1, 1, 1]], TOKENS, axis=0).T
        signs[:, -1] = [-1, 1, 1, 1, 1, 1]
        return sources.ravel().tolist(), signs.ravel().astype(np.float32)

    def _leg_length(self, joints: Float[np.ndarray, "joints 3"]) -> float:
        above = [self.skeleton.parents[joint] for joint in self.leg]
        return float(np.linalg.norm(joints[list(self.leg)] - joints[above], axis=-1).sum())


def smpl_features(
    rotations: Float[np.ndarray, "frames 24 3 3"], way: Float[np.ndarray, "frames 3"]
) -> Float[np.ndarray, "frames 150"]:
    """Returns rotations and the root trajectory in the layout of the networks, float32."""
    tokens = np.zeros((len(rotations), TOKENS, 6), np.float32)
    tokens[:, :-1] = sixd_from_matrix(rotations, "rows")
    tokens[:, -1, :3] = way
    return np.swapaxes(tokens, 1, 2).reshape(len(tokens), -1)


# The 150 features of HumanAct12 and UESTC, which name no frame rate; ACTOR plays 20 a second.
SMPL_FEATURES = SmplRepresentation(name="smpl", skeleton=skeleton.BODY, fps=20.0)


def representation_of(model: SmplModel) -> SmplRepresentation:
    """Returns the features `smpl`, whose joints are those of a model file."""
    return replace(SMPL_FEATURES, skeleton=model.skeleton, body=model.fingerprint)
