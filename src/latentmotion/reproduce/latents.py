"""Latents along the reverse process, by action, and their t-SNE maps (paper, appendix).

z_T (noise) → … → z_t → … → z_0, recorded at the denoiser's calls, → two dimensions each
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.interface import Estimates, Estimator
from latentmotion.diffusion.samplers import sample
from latentmotion.engine.request import GenerationRequest, padded_batch
from latentmotion.errors import MissingExtraError
from latentmotion.evaluation.report import Figure
from latentmotion.pipeline import MotionPipeline, sampler_of
from latentmotion.reproduce.plots import latent_maps

PER_LABEL = 30
"""Motions of each action, as in the paper."""

FRAMES = 60
"""Length of the motions, as of the paper's action data."""

CLEAN = -1.0
"""Timestep that stands for latents without noise."""


@dataclass
class Recorder:
    """An estimator around another that records its inputs."""

    estimator: Estimator
    """The other."""
    states: list[tuple[float, Any]] = field(default_factory=list)
    """Timestep and latents of every call."""

    def __call__(self, z: Any, t: float, condition: Conditioning, mask: Any) -> Estimates:
        """Records the latents and returns their estimates."""
        self.states.append((t, z.reshape(len(z), -1)))
        return self.estimator(z, t, condition, mask)


def draw_latents(generator: MotionPipeline, path: Path) -> dict[str, Figure]:
    """Draws the maps of a model of actions; returns the silhouettes of noise and latents."""
    known = generator.card.condition.known_prompts
    labels = [label for label in known for _ in range(PER_LABEL)]
    states = latents_along(generator, labels, min(FRAMES, generator.card.frames[1]))
    names = {t: f"t = {t:g}" for t, _ in states} | {CLEAN: "z₀"}
    latent_maps(path, {names[t]: map_of(z) for t, z in chosen(states)}, labels)
    return {
        "Silhouette of noise": Figure(silhouette(states[0][1], labels)),
        "Silhouette of latents": Figure(silhouette(states[-1][1], labels)),
    }


def latents_along(
    generator: MotionPipeline, labels: Sequence[str], frames: int
) -> list[tuple[float, Float[np.ndarray, "items numbers"]]]:
    """Samples a motion per label; returns the latents at each timestep, the last without noise.

    Args:
        generator: A model of actions with a global latent.
        labels: One per motion.
        frames: Length of the motions.
    """
    card = generator.card
    sampling = card.sampling.but(sampler="ddim")
    request = GenerationRequest(
        tuple(labels), (frames,) * len(labels), tuple(range(len(labels))), sampling
    )
    condition = generator.condition(labels)
    batch, noise = padded_batch(request, condition, card.latents, generator.backend)
    recorder, sampler = Recorder(generator.guided(sampling)), sampler_of(card, sampling)
    steps, to_host = sampling.steps, generator.backend.to_host
    z = sample(recorder, sampler, batch.noise, batch.condition, batch.tokens, steps, noise)
    return [(t, to_host(state)) for t, state in [*recorder.states, (CLEAN, z.reshape(len(z), -1))]]


def chosen(
    states: Sequence[tuple[float, np.ndarray]], count: int = 5
) -> list[tuple[float, np.ndarray]]:
    """Returns `count` of the states, evenly spaced from the first to the last."""
    indices = np.linspace(0, len(states) - 1, count).round().astype(int)
    return [states[index] for index in indices]


def map_of(latents: Float[np.ndarray, "items numbers"], seed: int = 0) -> np.ndarray:
    """Returns the t-SNE map (van der Maaten & Hinton 2008), (items, 2)."""
    try:
        from sklearn.manifold import TSNE
    except ModuleNotFoundError as error:
        raise MissingExtraError("t-SNE", "scikit-learn", "train") from error
    perplexity = min(30.0, (len(latents) - 1) / 3)
    tsne = TSNE(perplexity=perplexity, init="pca", random_state=seed)
    return tsne.fit_transform(latents.astype(np.float32))


def silhouette(latents: Float[np.ndarray, "items numbers"], labels: Sequence[str]) -> float:
    """Returns the mean silhouette of items by label, −1 to 1 (Rousseeuw 1987)."""
    from sklearn.metrics import silhouette_score

    return float(silhouette_score(latents, list(labels)))
