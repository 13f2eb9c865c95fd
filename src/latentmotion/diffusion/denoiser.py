"""The network that sees noisy latents, the time and the condition (paper, section 3.2).

    context = [time token, (length token,) condition words]   or the words added to the time
    in context:       encoder([latents, context]), of which the latents are kept
    cross-attention:  decoder(latents, memory = context)

Every part is passed in; `DenoiserConfig` knows the paper's and ours.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from jaxtyping import Bool, Float
from torch import Tensor, nn

from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.context import (
    AcrossContext,
    ContextFirst,
    InContext,
    LatentsFirst,
    LeapEmbedding,
    NoLeap,
    NumbersThenWords,
    SeePadding,
    SeparatePlaces,
    TimeAndLengthTokens,
    TimeToken,
    WordsAddedToTime,
)
from latentmotion.diffusion.leaps import Leap, Leaps
from latentmotion.nn.position import PositionKind, build_position
from latentmotion.nn.timestep import NumberEmbedding
from latentmotion.nn.transformer import TransformerConfig


class Denoiser(nn.Module):
    """Projections around a transformer.

    Args:
        latents_in: Latents to tokens of the transformer.
        latents_out: And back.
        condition_in: Words of the condition to tokens.
        numbers: Time and mask to one or two tokens.
        joining: Numbers and words to the context and its mask.
        places: Adds positions to latents and context.
        body: The transformer, called with latents, their mask, context and its mask.
        padding: What attention sees of the latents' mask.
        leaps: Adds the leap of a student of few steps to the numbers.
    """

    def __init__(
        self,
        latents_in: nn.Module,
        latents_out: nn.Module,
        condition_in: nn.Module,
        numbers: nn.Module,
        joining: nn.Module,
        places: nn.Module,
        body: nn.Module,
        padding: nn.Module,
        leaps: nn.Module,
    ) -> None:
        super().__init__()
        self.latents_in = latents_in
        self.latents_out = latents_out
        self.condition_in = condition_in
        self.numbers = numbers
        self.joining = joining
        self.places = places
        self.body = body
        self.padding = padding
        self.leaps = leaps

    def forward(
        self,
        z: Float[Tensor, "batch tokens width"],
        t: Float[Tensor, " batch"] | Float[Tensor, ""],
        condition: Conditioning,
        mask: Bool[Tensor, "batch tokens"],
        leap: Leap | None = None,
    ) -> Float[Tensor, "batch tokens width"]:
        """Returns the prediction, zero on padding.

        Args:
            z: Noisy latents.
            t: Time, one for all or one per item, in the units of the schedule.
            condition: Words and which of them are real.
            mask: True on real latent tokens.
            leap: What a student of few steps is told; None for any other denoiser.
        """
        numbers = self.numbers(t.expand(z.shape[0]), mask)
        numbers = self.leaps(numbers, leap)
        words = self.condition_in(condition.tokens)
        context, context_mask = self.joining(numbers, words, condition.mask)
        latents, context = self.places(self.latents_in(z), context)
        latents = self.body(latents, self.padding(mask), context, context_mask)
        return self.latents_out(latents) * mask[..., None]


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
    places: Literal["separate", "latents_first", "context_first"] = "separate"
    """Which positions share a table."""
    position: PositionKind = "learned"
    """Kind of position table."""
    sine_width: int = 256
    """Width of the time's sinusoid."""
    time_scale: float = 1.0
    """Multiplies the time: 1 for discrete times, 1000 for times in 0 .. 1."""
    length_token: bool = False
    """Whether the network is told the number of real latent tokens."""
    sees_padding: bool = False
    """Whether attention sees padded latents, a quirk of the authors' diffusion on raw frames."""
    leaps: Leaps | None = None
    """The leaps of a distilled model, which is told guidance and stride; null for any other."""

    def build(self) -> Denoiser:
        """Builds the network with fresh weights."""
        width = self.transformer.width
        inner, outer = (self.latent_width, width), (width, self.latent_width)
        return Denoiser(
            latents_in=nn.Linear(*inner) if self.project_latents else nn.Identity(),
            latents_out=nn.Linear(*outer) if self.project_latents else nn.Identity(),
            condition_in=self._condition_in(width),
            numbers=self._numbers(width),
            joining=WordsAddedToTime() if self.words == "added_to_time" else NumbersThenWords(),
            places=self._places(width),
            body=self._body(),
            padding=SeePadding() if self.sees_padding else nn.Identity(),
            leaps=LeapEmbedding(self.sine_width, width) if self.leaps else NoLeap(),
        )

    def _condition_in(self, width: int) -> nn.Module:
        linear = nn.Linear(self.condition_width, width, bias=self.condition_projection != "table")
        choices: dict[str, nn.Module] = {
            "linear": linear,
            "relu_linear": nn.Sequential(nn.ReLU(), linear),
            "table": linear,
            "none": nn.Identity(),
        }
        return choices[self.condition_projection]

    def _numbers(self, width: int) -> nn.Module:
        time = NumberEmbedding(self.sine_width, width, self.time_scale)
        if not self.length_token:
            return TimeToken(time)
        return TimeAndLengthTokens(time, NumberEmbedding(self.sine_width, width))

    def _places(self, width: int) -> nn.Module:
        tables: list[Any] = [
            build_position(self.position, width, self.transformer.dropout) for _ in range(2)
        ]
        if self.places == "separate":
            return SeparatePlaces(*tables)
        return {"latents_first": LatentsFirst, "context_first": ContextFirst}[self.places](
            tables[0]
        )

    def _body(self) -> nn.Module:
        if self.attention == "cross":
            return AcrossContext(self.transformer.decoder())
        return InContext(self.transformer.encoder())
