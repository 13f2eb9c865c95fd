"""Reach: moves latents until a motion meets its goals, by Gauss-Newton through the decoder alone.

    Δz = Jᵀ (J Jᵀ + λ I)⁻¹ r

r is what is missing and J its Jacobian, with a row for each coordinate of a goal; so the system is
as small as the goals are few, and of all ways to meet them the shortest in the latents is taken.
J costs more than all else, so it is kept as long as a step with it takes most of r away.

Gradients of joints to gradients of HumanML3D's features: the pullback of its `decode`.

    yaw_t = -2 Σ_{s<t} half_s        path_t = Σ_{1≤s≤t} turn(step_{s-1}, yaw_s)
    joint = turn(local, yaw) + path  turn'(v) = (v_z, 0, -v_x) for v turned already

So a joint pulls on its own features in its frame, and on turns and steps of the root before it.

Latents whose decoded features are given ones, found through the decoder, without an encoder.

The squared error of normalized features is minimized by L-BFGS (Liu & Nocedal 1989). That takes one
row of the decoder's pullback a step, and comes nearer to the motion than encoding it does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.diffusion.condition import Conditioning
from latentmotion.diffusion.parametrization import Estimates, Mask, ParametrizedDenoiser
from latentmotion.errors import InputError
from latentmotion.kinematics.skeleton import Joints
from latentmotion.representation.canonical import turn
from latentmotion.representation.humanml3d import HumanML3DRepresentation
from latentmotion.representation.interface import Representation, Scale

Latents = Float[np.ndarray, "tokens width"]

# Samples latents for so many frames, its estimates of the clean latents corrected by a function.
Sample = Callable[[int, Callable[[np.ndarray], np.ndarray]], Latents]

# Most halvings of a step that brings joints no nearer to their goals.
_HALVINGS = 4


@runtime_checkable
class Residual(Protocol):
    """Residuals of the goals, a number for each coordinate."""

    def __call__(self, joints: Joints) -> Float[np.ndarray, " rows"]:
        """Returns goal minus joint, meters."""
        ...

    def gradient(self, joints: Joints) -> Float[np.ndarray, "rows frames joints 3"]:
        """Returns the derivatives of the coordinates for which goals are set."""
        ...


@dataclass(frozen=True)
class DecodedMotion:
    """A motion as a function of its latents, with the derivatives of that function.

    `decoder` and `pullback` are sessions: `latents`, `mask` → normalized features, and `latents`,
    `mask`, `gradient` → gradient of the latents.
    """

    decoder: Callable[..., np.ndarray]
    pullback: Callable[..., np.ndarray]
    latents: Scale  # Scale in which the denoiser sees latents.
    features: Scale  # Scale in which the networks see features.
    representation: Representation  # Layout of the features: HumanML3D's or KIT's.
    frames: int  # Length of the motion.

    def __post_init__(self) -> None:
        joint_features(self.representation)

    def decode(self, z: Latents) -> Float[np.ndarray, "frames features"]:
        """Returns the features of latents in the denoiser's scale, in their own units."""
        latents = self.latents.denormalize(z)[None].astype(np.float32)
        normalized = self.decoder(latents=latents, mask=self._mask)[0]
        return self.features.denormalize(normalized.astype(np.float64))

    def joints(self, z: Latents) -> Joints:
        """Returns the joints of latents in the denoiser's scale."""
        return self.representation.decode(self.decode(z))

    def rows(
        self,
        z: Latents,
        features: Float[np.ndarray, "frames features"],
        joints: Joints,
        gradient: Float[np.ndarray, "rows frames joints 3"],
    ) -> Float[np.ndarray, "rows tokens width"]:
        """Returns gradients of latents in the denoiser's scale for gradients of joints.

        Args:
            z: The latents.
            features: What `decode` makes of them.
            joints: The joints of these features.
            gradient: A row for each number to be differentiated.
        """
        return self.features_pullback(
            z, joints_pullback(self.representation, features, joints, gradient)
        )

    def features_pullback(
        self, z: Latents, gradient: Float[np.ndarray, "rows frames first_features"]
    ) -> Float[np.ndarray, "rows tokens width"]:
        """Returns gradients of latents for those of features in their own units."""
        normalized = (
            gradient
            * np.broadcast_to(self.features.std, self.representation.width)[: gradient.shape[2]]
        )
        latents = self.latents.denormalize(z)[None].astype(np.float32)
        gradients = self.pullback(
            latents=latents, mask=self._mask, gradient=normalized.astype(np.float32)
        )
        return gradients * self.latents.std

    @property
    def _mask(self) -> Bool[np.ndarray, "1 frames"]:
        return np.ones((1, self.frames), bool)


@dataclass(frozen=True)
class ReachSettings:
    """Step sizes and number of steps by which latents are moved."""

    updates: int = 5  # Steps of Gauss-Newton at most.
    tolerance: float = 2e-4  # Meters of the worst coordinate at which it is done.
    damping: float = 1e-4  # λ, as a share of the mean of J Jᵀ's diagonal.
    cap: float = 0.5  # Root mean square, in the denoiser's scale, of one step at most.
    # Share of what was missing that may be left after a step for its Jacobian to serve again.
    keeps: float = 0.3
    # Halve a step that brings joints no nearer. Without, the last step needs no decoding.
    checked: bool = True


def reach(
    z: Latents,
    motion: DecodedMotion,
    residual: Residual,
    free: Bool[np.ndarray, " tokens"] | None = None,
    settings: ReachSettings = ReachSettings(),
) -> Latents:
    """Returns latents near the given ones whose motion meets the goals.

    Args:
        z: Latents in the denoiser's scale.
        motion: The motion as a function of latents.
        residual: What is missing to the goals.
        free: True on tokens that may be moved; by default all.
        settings: How far and how often they are moved.
    """
    features = motion.decode(z)
    joints = motion.representation.decode(features)
    missing, rows = residual(joints), None
    for update in range(settings.updates):
        if not len(missing) or np.abs(missing).max() < settings.tolerance:
            break
        reused = rows is not None
        if rows is None:
            rows = motion.rows(z, features, joints, residual.gradient(joints))
            rows = rows if free is None else rows * free[:, None]
        step = least_step(rows.reshape(len(missing), -1), missing, settings.damping)
        step = step.reshape(z.shape)
        size = float(np.sqrt(np.mean(step**2)))
        step = step * min(1.0, settings.cap / max(size, 1e-12))
        if not settings.checked and update == settings.updates - 1:
            return z + step
        for _ in range(_HALVINGS):
            features = motion.decode(z + step)
            joints = motion.representation.decode(features)
            after = residual(joints)
            if not settings.checked or (after**2).sum() < (missing**2).sum():
                faster = (after**2).sum() < settings.keeps**2 * (missing**2).sum()
                rows = rows if faster else None
                z, missing = z + step, after
                break
            step = step / 2
        else:
            if not reused:
                break
            features = motion.decode(z)
            joints = motion.representation.decode(features)
            rows = None
    return z


def least_step(
    jacobian: Float[np.ndarray, "rows numbers"], missing: Float[np.ndarray, " rows"], damping: float
) -> Float[np.ndarray, " numbers"]:
    """Returns Jᵀ (J Jᵀ + λ I)⁻¹ r, λ being `damping` times the mean of J Jᵀ's diagonal."""
    jacobian = jacobian.astype(np.float64)
    gram = jacobian @ jacobian.T
    gram[np.diag_indices_from(gram)] += damping * np.trace(gram) / len(gram) + 1e-12
    return jacobian.T @ np.linalg.solve(gram, missing)


@dataclass(frozen=True)
class CorrectedDenoiser:
    """An estimator around another that corrects its estimate of the clean latents.

    The noise is what is left: ε = (z_t - α z_0) / σ. Where known latents are put in (*keep*), the
    state of every sampler is then α z_0 + σ ε there, with the noise that sampling began with.
    """

    denoiser: ParametrizedDenoiser  # The network with its guidance.
    # Clean latents to corrected ones.
    correct: Callable[[Float[np.ndarray, "batch tokens width"]], Any]

    def __call__(self, z: Any, t: float, condition: Conditioning, mask: Mask) -> Estimates:
        """Returns the corrected latents, and the noise that is left."""
        clean = np.asarray(self.correct(self.denoiser(z, t, condition, mask)[0]), z.dtype)
        schedule = self.denoiser.schedule
        return clean, (z - schedule.alpha(t) * clean) / schedule.sigma(t)


@dataclass(frozen=True)
class Correction:
    """What is done to clean latents: known tokens are put in, others moved toward the goals."""

    motion: DecodedMotion
    residual: Residual | None = None  # Residuals of the goals; None without goals.
    # Latents in the denoiser's scale; those that are not known are not read.
    fixed: Latents | None = None
    is_known: Bool[np.ndarray, " tokens"] | None = None  # True on known tokens.
    settings: ReachSettings = field(default_factory=ReachSettings)

    def __call__(
        self, z: Float[np.ndarray, "1 tokens width"]
    ) -> Float[np.ndarray, "1 tokens width"]:
        """Returns corrected latents of one motion."""
        clean, free = np.array(z[0]), None
        if self.fixed is not None and self.is_known is not None:
            clean[self.is_known], free = self.fixed[self.is_known], ~self.is_known
        if self.residual is not None and self.settings.updates:
            clean = reach(clean, self.motion, self.residual, free, self.settings)
        return clean[None]


def joint_features(representation: Representation) -> int:
    """Returns how many of the features, the first ones, say where joints are.

    Raises:
        InputError: The representation is not HumanML3D's or KIT's.
    """
    if not isinstance(representation, HumanML3DRepresentation):
        raise InputError(
            f"goals need a model of HumanML3D's or KIT's features; this one makes "
            f"{representation.name!r}"
        )
    return representation.blocks["positions"].stop


def joints_pullback(
    representation: Representation,
    features: Float[np.ndarray, "frames features"],
    joints: Joints,
    gradient: Float[np.ndarray, "rows frames joints 3"],
) -> Float[np.ndarray, "rows frames first_features"]:
    """Returns the gradients of the features that say where joints are, in their own units.

    Args:
        representation: What the features mean.
        features: Of one motion.
        joints: What `decode` makes of them.
        gradient: Gradients of the joints, a row for each number to be differentiated.
    """
    rows, frames = gradient.shape[:2]
    blocks = representation.blocks
    yaw = -2 * np.concatenate([[0.0], np.cumsum(features[:-1, blocks["yaw_velocity"]][:, 0])])
    pulled = np.zeros((rows, frames, joint_features(representation)))
    local = turn(gradient, -yaw[:, None])
    pulled[..., blocks["root_height"]] = local[:, :, :1, 1]
    pulled[..., blocks["positions"]] = local[:, :, 1:].reshape(rows, frames, -1)

    root = joints[:, 0] * (1, 0, 1)
    around = joints - root[:, None]
    of_yaw = np.einsum("rtj,tj->rt", gradient[..., 0], around[..., 2])
    of_yaw -= np.einsum("rtj,tj->rt", gradient[..., 2], around[..., 0])
    # A step of the root moves all that follows.
    follows = np.cumsum(gradient.sum(axis=2)[:, ::-1], axis=1)[:, ::-1]
    steps = np.diff(root, axis=0)
    of_yaw[:, 1:] += follows[:, 1:, 0] * steps[:, 2] - follows[:, 1:, 2] * steps[:, 0]
    pulled[:, :-1, blocks["root_velocity"]] = turn(follows[:, 1:], -yaw[1:])[..., ::2]
    later = np.cumsum(of_yaw[:, ::-1], axis=1)[:, ::-1]
    pulled[:, :-1, blocks["yaw_velocity"]] = -2 * later[:, 1:, None]
    return pulled


# Steps that L-BFGS remembers by default, and takes at most to find the latents of joints.
_MEMORY, _ITERATIONS = 12, 60


def fit_latents(motion: DecodedMotion, joints: Joints) -> Latents:
    """Returns latents, in the denoiser's scale, whose motion moves as the joints do.

    Args:
        motion: As long as the joints.
        joints: Positions, meters, of the model's skeleton.
    """
    # The last frame has no velocity; the one before is kept.
    ahead = joints[-1:] + (joints[-1:] - joints[-2:-1])
    features = motion.representation.encode(np.concatenate([joints, ahead]))
    return fit_features(motion, features, np.ones(features.shape), 0.0, _ITERATIONS)


def fit_features(
    motion: DecodedMotion,
    target: Float[np.ndarray, "frames features"],
    weights: Float[np.ndarray, "frames features"],
    prior: float,
    iterations: int,
) -> Latents:
    """Returns latents, in the denoiser's scale, whose features are near given ones.

    Args:
        motion: As long as the features.
        target: The features, in their own units; all of them, or the first ones.
        weights: How much each of them counts.
        prior: How much a latent counts that is not 0, beside a normalized feature.
        iterations: Steps at most.
    """
    target, count = np.asarray(target, np.float64), target.shape[1]
    std = np.broadcast_to(motion.features.std, motion.representation.width)[:count]
    weight, prior = weights / (std * std * target.size), prior / target.size
    width = latent_width(motion)

    def loss(z: Float[np.ndarray, " numbers"]) -> tuple[float, Float[np.ndarray, " numbers"]]:
        latents = z.reshape(-1, width)
        gap = motion.decode(latents)[:, :count] - target
        slope = motion.features_pullback(latents, (gap * weight)[None])
        value = float((gap * gap * weight).sum() + prior * (z @ z))
        return 0.5 * value, slope.astype(np.float64).ravel() + prior * z

    tokens = -(-len(target) // 4)
    return lbfgs(loss, np.zeros(tokens * width), iterations).reshape(tokens, width)


def latent_width(motion: DecodedMotion) -> int:
    """Returns how many numbers a token has."""
    return int(np.broadcast_to(motion.latents.std, motion.latents.mean.shape).size)


def lbfgs(
    loss: Callable[[np.ndarray], tuple[float, np.ndarray]],
    start: Float[np.ndarray, " numbers"],
    iterations: int,
    memory: int = _MEMORY,
) -> Float[np.ndarray, " numbers"]:
    """Returns where a function is small: L-BFGS with steps that are halved until they help.

    Args:
        loss: Value and gradient.
        start: Where it begins.
        iterations: Steps at most.
        memory: Steps that are remembered.
    """
    x, (value, slope) = start, loss(start)
    history: list[tuple[np.ndarray, np.ndarray]] = []
    for _ in range(iterations):
        direction, factors = -slope, []
        for step, bend in reversed(history):
            factors.append((step @ direction) / (step @ bend))
            direction = direction - factors[-1] * bend
        if history:
            step, bend = history[-1]
            direction = direction * (step @ bend) / (bend @ bend)
        else:
            direction = direction / max(float(np.sqrt(np.mean(slope**2))), 1e-12) * 0.1
        for (step, bend), factor in zip(history, reversed(factors), strict=True):
            direction = direction + step * (factor - (bend @ direction) / (step @ bend))
        size = 1.0
        while size > 1e-3:
            after, after_slope = loss(x + size * direction)
            if after < value + 1e-4 * size * float(slope @ direction):
                break
            size /= 2
        else:
            break
        step, bend = size * direction, after_slope - slope
        if step @ bend > 1e-12 * (bend @ bend):
            history = [*history[1 - memory :], (step, bend)]
        improved = value - after
        x, value, slope = x + step, after, after_slope
        if improved < 1e-5 * value:
            break
    return x
