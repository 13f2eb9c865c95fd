"""The generator's chain on PyTorch's tensors: from words to joints nothing leaves the device.

    host: prompts → words, seeds → noise       device: noise, words → latents → features → joints

Noise is drawn on the CPU, so that a seed means the same motion everywhere.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.interface import Noise
from latentmotion.diffusion.noise import SeededNoise
from latentmotion.diffusion.sampler import sample
from latentmotion.generator import MotionGenerator
from latentmotion.order import Order
from latentmotion.representation.humanml3d import HumanML3DRepresentation
from latentmotion.runtime.buckets import Sizes
from latentmotion.runtime.launch import Launcher, directly

Walk = Callable[[Tensor, Tensor, Tensor, Tensor], Tensor]
"""From noise, the mask of tokens, words and their mask to latents."""


@dataclass(frozen=True)
class Batch:
    """What goes to the device for one batch."""

    noise: Float[Tensor, "batch tokens width"]
    """Where sampling starts."""
    tokens: Bool[Tensor, "batch tokens"]
    """True on real latent tokens."""
    words: Float[Tensor, "batch words channels"]
    """The condition."""
    seen: Bool[Tensor, "batch words"]
    """True on real words."""
    frames: Bool[Tensor, "batch frames"]
    """True on real frames."""


@dataclass(frozen=True)
class DeviceGenerator(MotionGenerator):
    """A generator whose sessions take and give tensors, as `runtime.eager` makes them."""

    _: KW_ONLY
    device: torch.device
    """Where they live."""
    sizes: Sizes
    """To which sizes batches are filled."""
    launch: Launcher
    """Runs the chain."""

    def together(self, order: Order) -> Float[np.ndarray, "batch frames features"]:
        """Walks the chain for one batch; what lies beyond a motion's length means nothing."""
        features = self.features_of(self.condition(order.prompts), order)
        return self._taken(features, order)

    def latents(
        self, condition: Conditioning, order: Order
    ) -> Float[np.ndarray, "batch tokens width"]:
        """Walks from noise to latents, guided (paper eq. 6), in the scale of the VAE."""
        noise = self._noise(order)
        batch = self._batch(condition, order, noise)
        latents = self._walk(order, noise)(batch.noise, batch.tokens, batch.words, batch.seen)
        tokens = self.card.latents.tokens_of(max(order.frames))
        return latents[: len(order.seeds), :tokens].cpu().numpy()

    def features_of(
        self, condition: Conditioning, order: Order
    ) -> Float[Tensor, "rows longest features"]:
        """Walks from words to features, on the device and filled up to its sizes."""
        noise = self._noise(order)
        batch, walk = self._batch(condition, order, noise), self._walk(order, noise)

        def chain(z: Tensor, tokens: Tensor, words: Tensor, seen: Tensor, frames: Tensor) -> Tensor:
            return self._decoded(walk(z, tokens, words, seen), frames)

        # Fresh noise at every step comes from the host, which no recording asks.
        launch = directly if order.sampler == "ddpm" else self.launch
        name = order.steps, order.guidance, order.sampler
        return launch(name, chain, *vars(batch).values())

    def joints_of(
        self, features: Float[Tensor, "rows longest features"]
    ) -> Float[Tensor, "rows longest joints 3"]:
        """Places the joints, on the device."""
        # SMPL's way there asks the host for constants.
        plain = isinstance(self.representation, HumanML3DRepresentation)
        launch = self.launch if plain else directly
        return launch("joints", self.representation.decode, features)

    def _joints(self, order: Order) -> list[Float[np.ndarray, "_ joints 3"]]:
        return self._each(order, self._joints_together)

    def _joints_together(self, order: Order) -> Float[np.ndarray, "batch frames joints 3"]:
        features = self.features_of(self.condition(order.prompts), order)
        return self._taken(self.joints_of(features), order)

    def _taken(self, output: Tensor, order: Order) -> np.ndarray:
        return output[: len(order.seeds), : max(order.frames)].cpu().numpy()

    def _walk(self, order: Order, noise: Noise) -> Walk:
        guided, sampler = self._guided(order), self._sampler(order)
        mean, std = self._latent_scale

        def walk(z: Tensor, tokens: Tensor, words: Tensor, seen: Tensor) -> Tensor:
            condition = Conditioning(words, seen)
            return sample(guided, sampler, z, condition, tokens, order.steps, noise) * std + mean

        return walk

    def _decoded(self, latents: Tensor, frames: Tensor) -> Tensor:
        normalized: Any = self.decoder(latents=latents, mask=frames)
        mean, std = self._feature_scale
        return normalized * std + mean

    def _batch(self, condition: Conditioning, order: Order, noise: Noise) -> Batch:
        longest, rows = self.sizes.frames(max(order.frames)), self.sizes.rows(len(order.seeds))
        space, frames = self.card.latents, np.array(_filled(order.frames, rows))
        shape = rows, space.tokens_of(longest), space.width
        tokens = np.array([space.tokens_of(length) for length in frames.tolist()])
        words = _padded(condition, rows, self.sizes.words(condition.mask.shape[1]))
        return Batch(
            noise=self._placed(noise(shape)),
            tokens=self._placed(np.arange(shape[1]) < tokens[:, None]),
            words=self._placed(words.tokens),
            seen=self._placed(words.mask),
            frames=self._placed(np.arange(longest) < frames[:, None]),
        )

    def _noise(self, order: Order) -> SeededNoise:
        rows = self.sizes.rows(len(order.seeds))
        tokens = map(self.card.latents.tokens_of, _filled(order.frames, rows))
        return SeededNoise(_filled(order.seeds, rows), list(tokens))

    def _placed(self, array: np.ndarray) -> Tensor:
        return torch.tensor(array, device=self.device)

    @cached_property
    def _null(self) -> Conditioning:
        null = self.condition.null(1)
        return Conditioning(self._placed(null.tokens), self._placed(null.mask))

    @cached_property
    def _latent_scale(self) -> tuple[Tensor, Tensor]:
        space = self.card.latents
        return self._row(space.mean), self._row(space.std)

    @cached_property
    def _feature_scale(self) -> tuple[Tensor, Tensor]:
        return self._row(self.card.normalizer_mean), self._row(self.card.normalizer_std)

    def _row(self, numbers: Sequence[float]) -> Tensor:
        return self._placed(np.array(numbers, np.float32))


def _filled(values: Sequence[int], rows: int) -> list[int]:
    """The values, the last of them repeated up to `rows`."""
    return [*values, *[values[-1]] * (rows - len(values))]


def _padded(condition: Conditioning, rows: int, words: int) -> Conditioning:
    """The condition with its last row repeated, and words of zero that nobody sees."""
    count, seen = condition.mask.shape
    repeated = _filled(range(count), rows)
    missing = (0, 0), (0, words - seen)
    return Conditioning(
        np.pad(condition.tokens[repeated], (*missing, (0, 0))),
        np.pad(condition.mask[repeated], missing),
    )
