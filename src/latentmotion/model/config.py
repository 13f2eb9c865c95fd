"""Configurations of transformers, denoisers and sampling; those of VAEs are in `vae_config`.

They are plain numbers that `networks.build` makes networks of; a card and a run folder keep them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from latentmotion.diffusion.few_step import FewStepConfig
from latentmotion.diffusion.guidance import GuidanceRule
from latentmotion.diffusion.samplers import SamplerName
from latentmotion.errors import InputError
from latentmotion.storage import limits

PositionKind = Literal["learned", "sine"]
"""Position tables learned as in the paper, or sines as in ACTOR."""


def check_range(name: str, number: int, most: int, least: int = 1) -> None:
    """Raises InputError for a size that is not from `least` to `most`."""
    if not least <= number <= most:
        raise InputError(f"{name} {number}: expected {least} to {most:,}")


@dataclass(frozen=True)
class TransformerConfig:
    """Size and shape of a stack; the defaults are the paper's.

    Raises:
        InputError: A size is out of range.
    """

    width: int = 256
    """Numbers per token."""
    layers: int = 9
    """Number of layers, odd where there are skips."""
    heads: int = 4
    """Attention heads."""
    hidden: int = 1024
    """Width inside the feed-forward part."""
    dropout: float = 0.1
    """Share of numbers dropped in training."""
    attention_dropout: float = 0.0
    """Share of attention dropped in training; the authors drop 0.1, at a third of the speed."""
    activation: Literal["gelu", "relu"] = "gelu"
    """Activation of the feed-forward part."""
    norm: Literal["post", "pre"] = "post"
    """Whether a layer normalizes after or before each of its parts."""
    skips: bool = True
    """Whether first and last layers are joined."""
    final_norm: bool = True
    """Whether a last normalization closes the stack."""

    def __post_init__(self) -> None:
        check_range("width", self.width, limits.MOST_WIDTH)
        check_range("layers", self.layers, limits.MOST_LAYERS, least=0)
        check_range("heads", self.heads, self.width)
        check_range("hidden", self.hidden, limits.MOST_WIDTH)
        if self.width % self.heads:
            raise InputError(f"{self.heads} heads of a width of {self.width}; expected a divisor")

    def scaled(self, width: int, layers: Mapping[int, int]) -> TransformerConfig:
        """Returns the same stack in another size.

        Args:
            width: Numbers per token; inside the feed-forward part it is twice that.
            layers: New numbers of layers by the old; a number that is not there stays.
        """
        count = layers.get(self.layers, self.layers)
        return replace(self, width=width, hidden=2 * width, layers=count)


@dataclass(frozen=True)
class DenoiserConfig:
    """Which parts a `Denoiser` has; the defaults are ours, the presets have the paper's."""

    latent_width: int = 16
    """Numbers per latent token."""
    condition_width: int = 384
    """Numbers per word of the condition."""
    transformer: TransformerConfig = field(
        default_factory=lambda: TransformerConfig(layers=5, hidden=1024)
    )
    """The stack inside."""
    project_latents: bool = True
    """Whether a learned projection leads latents in and out; without, the widths must be equal."""
    condition_projection: Literal["linear", "relu_linear", "table", "none"] = "linear"
    """How words become tokens; `table` is for one-hot labels, `relu_linear` is the paper's."""
    words: Literal["tokens", "added_to_time"] = "tokens"
    """Whether words are tokens of their own, or added to the time's as in MDM."""
    attention: Literal["in_context", "cross"] = "in_context"
    """How latents meet the context."""
    positions: Literal["separate", "latents_first", "context_first"] = "separate"
    """Which positions share a table."""
    position: PositionKind = "learned"
    """Kind of position table."""
    sine_width: int = 256
    """Width of the time's sinusoid."""
    time_scale: float = 1.0
    """Multiplies the time: 1 for discrete times, 1000 for times in 0 .. 1."""
    length_token: bool = False
    """Whether the number of real latent tokens is an input of the network."""
    attends_to_padding: bool = False
    """Whether attention sees padded latents, a quirk of the authors' diffusion on raw frames."""
    few_step: FewStepConfig | None = None
    """Step counts of a distilled model, which has guidance and step size as inputs; null for any
    other."""

    def __post_init__(self) -> None:
        for name in ("latent_width", "condition_width", "sine_width"):
            check_range(name, getattr(self, name), limits.MOST_WIDTH)


@dataclass(frozen=True)
class Sampling:
    """How the model is sampled where nothing else is asked."""

    steps: int = 50
    """Sampling steps."""
    guidance: float = 7.5
    """Guidance scale (paper eq. 6)."""
    sampler: SamplerName = "ddim"
    """Rule of a sampling step."""
    guidance_rule: GuidanceRule = "classifier_free"
    """Kind of guidance; a distilled model learned it from its teacher."""

    def __post_init__(self) -> None:
        if not 1 <= self.steps <= limits.MOST_STEPS:
            raise InputError(f"{self.steps} sampling steps: expected 1 to {limits.MOST_STEPS:,}")

    def but(
        self,
        steps: int | None = None,
        guidance: float | None = None,
        sampler: SamplerName | None = None,
    ) -> Sampling:
        """Returns it with other values for those that are not None."""
        given = {"steps": steps, "guidance": guidance, "sampler": sampler}
        return replace(self, **{name: value for name, value in given.items() if value is not None})
