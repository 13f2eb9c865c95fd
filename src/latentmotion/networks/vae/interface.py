"""The interface of every motion VAE, and the losses of training (paper, section 3.1).

Two VAEs with the same encoder weights have the same latents, so one denoiser fits both.

L = |x̂ − x| + |joints(x̂) − joints(x)| + w KL(q(z | x) ‖ N(0, 1)),  smooth L1 distances
Action data: the vertices of a body that stays in place, instead of joints.
Ours, off by default: velocities of joints, of standing feet and of bodies at rest, lengths of
bones, and magnitudes of short-time spectra. Frame by frame the best guess of an unknown phase is
the mean of all, which is smooth; magnitudes stay as large as they are.
Means are taken over the real part of padded batches, so padding weighs nothing.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from hashlib import sha256
from typing import ClassVar

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn

from latentmotion.kinematics.skeleton import Skeleton

# Normalized features and latents, padded, and what of them is real.
Features = Float[Tensor, "batch frames features"]
Latents = Float[Tensor, "batch tokens width"]
FrameMask = Bool[Tensor, "batch frames"]
TokenMask = Bool[Tensor, "batch tokens"]


@dataclass(frozen=True)
class Posterior:
    """q(z | motion) = N(mean, exp(logvar))."""

    mean: Latents  # Mean of each latent number.
    logvar: Latents  # Logarithm of its variance.

    @property
    def std(self) -> Latents:
        """Standard deviation of each latent number."""
        return torch.exp(0.5 * self.logvar)

    def kl(self) -> Latents:
        """Returns KL(q ‖ N(0, 1)) of each latent number, in nats."""
        return 0.5 * (self.mean**2 + self.logvar.exp() - 1 - self.logvar)


class MotionVAE(nn.Module, ABC):
    """A variational autoencoder of normalized motion features.

    The real frames of a mask come first. Padding never changes a real frame, and a batch of two
    motions is two batches of one; `eval()` makes everything but the posterior's draw
    deterministic.

    Attributes:
        latent_width: Numbers per latent token.
    """

    latent_width: int

    # Names of the modules that `decode` runs; what is left makes the latents.
    DECODER_MODULES: ClassVar[tuple[str, ...]] = ("decoder",)

    @abstractmethod
    def encode(self, features: Features, mask: FrameMask) -> Posterior:
        """Returns the distribution of the latents, (batch, tokens, width).

        Args:
            features: Normalized features; what padding holds does not matter.
            mask: True on real frames.
        """

    @abstractmethod
    def decode(self, latents: Latents, mask: FrameMask) -> Features:
        """Returns normalized features, zero on padding.

        Args:
            latents: Latents of as many tokens as `encode` gives for these frames.
            mask: True on real frames; sets the length of each motion.
        """

    @abstractmethod
    def latent_mask(self, mask: FrameMask) -> TokenMask:
        """Returns which latent tokens are real, from which frames are."""


def decoder_modules(vae: MotionVAE) -> nn.ModuleDict:
    """Returns the modules that turn latents into features, by name."""
    return nn.ModuleDict({name: getattr(vae, name) for name in vae.DECODER_MODULES})


def encoder_state(vae: MotionVAE) -> dict[str, Tensor]:
    """Returns all weights that make latents, by name."""
    weights = vae.state_dict().items()
    return {
        name: value for name, value in weights if name.partition(".")[0] not in vae.DECODER_MODULES
    }


def fingerprint(vae: MotionVAE) -> str:
    """Returns a hash of all weights that make latents; a zero has no sign in it."""
    digest = sha256()
    for name, value in encoder_state(vae).items():
        digest.update(name.encode() + (value + 0.0).cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()


def copy_encoder(vae: MotionVAE, trained: MotionVAE) -> None:
    """Copies the encoder of a trained VAE, frozen, and the decoder weights that match.

    Alike are the weights from the latents on, up to where name or shape differs.
    """
    state, trained_state = (decoder_modules(model).state_dict().items() for model in (vae, trained))
    alike: dict[str, Tensor] = {}
    for (name, value), (other, trained_value) in zip(state, trained_state, strict=False):
        if name != other or value.shape != trained_value.shape:
            break
        alike[name] = trained_value
    vae.load_state_dict({**vae.state_dict(), **encoder_state(trained), **alike})
    vae.requires_grad_(False)
    decoder_modules(vae).requires_grad_(True)


def mean_of_real(
    values: Float[Tensor, "batch length *_ width"], mask: Bool[Tensor, "batch length"]
) -> Float[Tensor, ""]:
    """Returns the mean over each row's real part, then over rows.

    So padding weighs nothing, and the mean of a batch is the mean of its equal parts.
    """
    weights = mask / mask.sum(dim=1, keepdim=True)
    return (values.flatten(2).mean(dim=2) * weights).sum(dim=1).mean()


# Speed in m/s below which a true foot joint counts as standing; real contacts slide at 0.14.
STANDING = 0.2

AT_REST = 0.12  # Mean speed of all joints in m/s below which a body is at rest.

SPECTRUM_SECONDS = 0.6  # Length of the windows whose spectra are compared: a step of a run, a clap.

# Hertz from which spectra are compared; slower movement is known frame by frame.
SPECTRUM_FROM = 3.0

Mean = Callable[[Tensor, Tensor], Tensor]  # Values and the mask of what is real to a number.


@dataclass(frozen=True)
class VAEObjective:
    """Weights of the losses; the defaults are the authors'."""

    features: float = 1.0  # Weight of the distance of normalized features.
    # Whether that is the squared error, as the paper states, or the authors' smooth L1.
    squared: bool = False
    joints: float = 1.0  # Weight of the distance of joints in the world, meters.
    velocity: float = 0.0  # Weight of the distance of joints' velocities, meters a second.
    # Weight of the squared distance of joints' velocities relative to the pelvis, meters a second;
    # a square weighs what is quick: punches, kicks, waves.
    limbs: float = 0.0
    # Weight of the distance of foot velocities, meters a second, where the true foot stands.
    contacts: float = 0.0
    # Weight of the speed of joints, meters a second, where the true body is at rest.
    rest: float = 0.0
    # Weight of the squared distance of magnitudes of joints' accelerations, meters a second
    # squared, in each band of frequencies from 3 Hz up.
    spectrum: float = 0.0
    bones: float = 0.0  # Weight of the distance of bone lengths, meters.
    kl: float = 1e-4  # Weight of the Kullback-Leibler divergence from N(0, 1), per latent number.
    # Distance in meters at which the joints' loss changes from quadratic to linear.
    joints_huber_delta: float = 1.0
    # Weight of the distance of the body's vertices without its way, meters; needs a body.
    vertices: float = 0.0
    # Whether means run over padding too, as in the authors' code. Padded features are equal, which
    # dilutes their mean; padded joints are the mean pose at the motion's last position.
    padded_means: bool = False

    @property
    def mean(self) -> Mean:
        """Averaging of distances and divergences over a padded batch."""
        return (lambda values, mask: values.mean()) if self.padded_means else mean_of_real


def vae_losses(
    vae: MotionVAE,
    features: Features,
    mask: FrameMask,
    noise: Callable[..., Tensor],
    joints_of: Callable[[Tensor], Tensor],
    fps: float,
    objective: VAEObjective,
    vertices_of: Callable[[Tensor], Tensor] | None = None,
    skeleton: Skeleton | None = None,
    latents_of: Callable[[Tensor, Tensor], Tensor] = lambda drawn, mask: drawn,
) -> dict[str, Tensor]:
    """Encodes, draws, decodes and compares.

    Args:
        vae: The network.
        features: Normalized features.
        mask: True on real frames.
        noise: Draws standard normal numbers, a row of the given shape for each motion.
        joints_of: Normalized features to joints, (batch, frames, joints, 3), meters.
        fps: Frames per second.
        objective: Weights of the losses.
        vertices_of: Normalized features to vertices, (batch, frames, vertices, 3), meters.
        skeleton: Whose feet and bones are compared, where the objective does.
        latents_of: Drawn latents and their mask to those that are decoded.

    Returns:
        "total", and each loss by the name of its weight.
    """
    posterior = vae.encode(features, mask)  #                        (batch, tokens, width)
    latents = posterior.mean + posterior.std * noise(*posterior.mean.shape[1:])
    latents = latents_of(latents, vae.latent_mask(mask))
    rebuilt = vae.decode(latents, mask).float()  #                   (batch, frames, features)
    losses = {
        **feature_losses(rebuilt, features, mask, joints_of, fps, objective, skeleton),
        "kl": objective.mean(posterior.kl().float(), vae.latent_mask(mask)),
    }
    if vertices_of is not None:
        surfaces = vertices_of(rebuilt), vertices_of(features)
        losses["vertices"] = objective.mean(_distance(*surfaces, 1.0), mask)
    weighted = [getattr(objective, name) * loss for name, loss in losses.items()]
    return {"total": torch.stack(weighted).sum(), **losses}


def feature_losses(
    output: Features,
    true: Features,
    mask: FrameMask,
    joints_of: Callable[[Tensor], Tensor],
    fps: float,
    objective: VAEObjective,
    skeleton: Skeleton | None = None,
) -> dict[str, Tensor]:
    """Compares normalized features, and the joints, velocities and bones that they stand for.

    Returns:
        Each loss by the name of its weight; those of feet and bones where a skeleton is given.
    """
    huber_delta, mean = objective.joints_huber_delta, objective.mean
    joints = joints_of(output), joints_of(true)  # (batch, frames, joints, 3)
    velocities = (fps * joints[0].diff(dim=1), fps * joints[1].diff(dim=1))
    limb_error = (velocities[0] - velocities[0][:, :, :1]) - (
        velocities[1] - velocities[1][:, :, :1]
    )
    losses = {
        "features": mean(
            F.mse_loss(output, true, reduction="none")
            if objective.squared
            else _distance(output, true, 1.0),
            mask,
        ),
        "joints": mean(_distance(*joints, huber_delta), mask),
        "velocity": mean(_distance(*velocities, huber_delta * fps), mask[:, 1:]),
        "limbs": mean(limb_error**2, mask[:, 1:]),
    }
    if objective.rest > 0:
        still = velocities[1].norm(dim=-1).mean(dim=-1)[..., None, None] < AT_REST
        losses["rest"] = mean(still * velocities[0].norm(dim=-1, keepdim=True), mask[:, 1:])
    if objective.spectrum > 0:
        losses["spectrum"] = _spectral_distance(*velocities, mask, fps, mean)
    if skeleton is None:
        return losses
    feet = [*skeleton.left_foot, *skeleton.right_foot]
    found_feet, true_feet = (velocity[:, :, feet] for velocity in velocities)
    stands = (true_feet.norm(dim=-1, keepdim=True) < STANDING).to(found_feet.dtype)
    parents = list(skeleton.parents[1:])
    found_bones, true_bones = (
        (positions[:, :, 1:] - positions[:, :, parents]).norm(dim=-1) for positions in joints
    )
    return losses | {
        "contacts": mean(stands * _distance(found_feet, true_feet, STANDING), mask[:, 1:]),
        "bones": mean(_distance(found_bones, true_bones, huber_delta), mask),
    }


def _spectral_distance(
    output: Float[Tensor, "batch steps joints 3"],
    true: Float[Tensor, "batch steps joints 3"],
    mask: FrameMask,
    fps: float,
    mean: Mean,
) -> Float[Tensor, ""]:
    """Compares how large accelerations are in each band of frequencies, in windows that overlap.

    Args:
        output: Velocities of joints; the first is that of the pelvis, from which the others count.
        true: The true ones.
        mask: True on real frames.
        fps: Frames per second.
        mean: Averaging over windows.
    """
    length = round(SPECTRUM_SECONDS * fps)
    hop = max(1, length // 4)
    real = mask[:, 2:].unfold(1, length, hop).all(dim=-1)
    if mask.shape[1] < length + 2 or not real.any():
        return output.new_zeros(())
    first = math.ceil(SPECTRUM_FROM * length / fps)
    weights = torch.hann_window(length, device=output.device)

    def magnitudes(velocities: Tensor) -> Tensor:
        pelvis = velocities[:, :, :1]
        apart = torch.cat([pelvis, velocities[:, :, 1:] - pelvis], dim=2)
        windows = (fps * apart.diff(dim=1)).unfold(1, length, hop)
        spectrum = torch.fft.rfft(windows * (2 * weights / weights.sum()))[..., first:]
        power = spectrum.real**2 + spectrum.imag**2  # (batch, windows, joints, 3, bands)
        return (power.sum(dim=3) + 1e-4).sqrt()

    squares = (magnitudes(output) - magnitudes(true)) ** 2
    whole = real.any(dim=1)
    return mean(squares[whole], real[whole]) * whole.float().mean()


def _distance(output: Tensor, true: Tensor, huber_delta: float) -> Tensor:
    return F.smooth_l1_loss(output, true, reduction="none", beta=huber_delta)
