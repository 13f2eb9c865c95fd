"""The network that sees noisy latents, the time and the condition (paper, section 3.2).

    context = [time token, (length token,) condition words]   or the words added to the time
    in context:       encoder([latents, context]), of which the latents are kept
    cross-attention:  decoder(latents, memory = context)

Every part is passed in; `networks.build` makes them of a `DenoiserConfig`.
"""

from __future__ import annotations

from jaxtyping import Bool, Float
from torch import Tensor, nn

from latentmotion.condition.interface import Conditioning
from latentmotion.diffusion.few_step import StepCondition
from latentmotion.networks.context import NoStepEmbedding, StepEmbedding


class Denoiser(nn.Module):
    """Projections around a transformer.

    Args:
        latents_in: Latents to tokens of the transformer.
        latents_out: And back.
        condition_in: Words of the condition to tokens.
        numbers: Time and mask to one or two tokens.
        joining: Numbers and words to the context and its mask.
        positions: Adds positions to latents and context.
        body: The transformer, called with latents, their mask, context and its mask.
        padding: What attention sees of the latents' mask.
        step_embedding: Adds the step condition of a few-step student to the numbers.
    """

    def __init__(
        self,
        latents_in: nn.Module,
        latents_out: nn.Module,
        condition_in: nn.Module,
        numbers: nn.Module,
        joining: nn.Module,
        positions: nn.Module,
        body: nn.Module,
        padding: nn.Module,
        step_embedding: StepEmbedding | NoStepEmbedding,
    ) -> None:
        super().__init__()
        self.latents_in = latents_in
        self.latents_out = latents_out
        self.condition_in = condition_in
        self.numbers = numbers
        self.joining = joining
        self.positions = positions
        self.body = body
        self.padding = padding
        self.step_embedding = step_embedding

    @property
    def further_inputs(self) -> tuple[str, ...]:
        """What a few-step student gets beside the rest, by name; else nothing."""
        return self.step_embedding.inputs

    def forward(
        self,
        z: Float[Tensor, "batch tokens width"],
        t: Float[Tensor, " batch"] | Float[Tensor, ""],
        condition: Conditioning,
        mask: Bool[Tensor, "batch tokens"],
        step_condition: StepCondition | None = None,
    ) -> Float[Tensor, "batch tokens width"]:
        """Returns the prediction, zero on padding.

        Args:
            z: Noisy latents.
            t: Time, one for all or one per item, in the units of the schedule.
            condition: Words and which of them are real.
            mask: True on real latent tokens.
            step_condition: What a few-step student gets; None for any other denoiser.
        """
        numbers = self.numbers(t.expand(z.shape[0]), mask)
        numbers = self.step_embedding(numbers, step_condition)
        words = self.condition_in(condition.tokens)
        context, context_mask = self.joining(numbers, words, condition.mask)
        latents, context = self.positions(self.latents_in(z), context)
        latents = self.body(latents, self.padding(mask), context, context_mask)
        return self.latents_out(latents) * mask[..., None]
