"""The denoiser and the parts it is made of (paper, section 3.2): noisy latents, time, condition.

    context = [time token, (length token,) condition words]   or the words added to the time
    in context:       encoder([latents, context]), of which the latents are kept
    cross-attention:  decoder(latents, memory = context)

Numbers (time, length) become tokens, context and latents get positions, and a transformer reads
both. A `DenoiserConfig` says which parts there are.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from latentmotion.diffusion.condition import Conditioning
from latentmotion.diffusion.schedule import StepCondition
from latentmotion.model.config import DenoiserConfig
from latentmotion.networks import transformer
from latentmotion.networks.transformer import NumberEmbedding


class Standardization(nn.Module):
    """Brings each number of a word to mean 0 and deviation 1, as measured on training prompts.

    Args:
        width: Numbers per word.
    """

    mean: Tensor
    scale: Tensor

    def __init__(self, width: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(width))
        self.register_buffer("scale", torch.ones(width))

    def measure(self, words: Float[Tensor, "words width"]) -> None:
        """Sets mean and deviation to those of some words; a constant number stays as it is."""
        deviation, mean = torch.std_mean(words.double(), dim=0, unbiased=False)
        self.mean.copy_(mean)
        self.scale.copy_(torch.where(deviation > 1e-6, 1 / deviation.clamp(min=1e-6), 1.0))

    def forward(self, words: Tensor) -> Tensor:
        """Returns the words in unit scale."""
        return (words - self.mean) * self.scale


class NumberTokens(nn.Module):
    """The time of the diffusion and, where wanted, the number of real latent tokens, as tokens."""

    def __init__(self, time: NumberEmbedding, length: NumberEmbedding | None) -> None:
        super().__init__()
        self.time = time
        self.length = length

    def forward(self, t: Tensor, mask: Tensor) -> Tensor:
        """Returns (batch, 1 or 2, width)."""
        if self.length is None:
            return self.time(t)[:, None]
        return torch.stack([self.time(t), self.length(mask.sum(dim=1).to(t.dtype))], dim=1)


class StepEmbedding(nn.Module):
    """Guidance scale and step size, added to the token of the time; nothing at first.

    Args:
        sine_width: Width of their sinusoids.
        width: Width of the token.
    """

    inputs = ("guidance", "step_size")

    def __init__(self, sine_width: int, width: int) -> None:
        super().__init__()
        self.guidance = NumberEmbedding(sine_width, width, scale=100.0)
        self.step_size = NumberEmbedding(sine_width, width, scale=1000.0)
        for embedding in (self.guidance, self.step_size):
            for weight in embedding.network[-1].parameters():
                nn.init.zeros_(weight)

    def forward(self, numbers: Tensor, step_condition: StepCondition) -> Tensor:
        """Returns the numbers' tokens, the first of them moved."""
        step = self.guidance(step_condition.guidance) + self.step_size(step_condition.step_size)
        return torch.cat([numbers[:, :1] + step[:, None], numbers[:, 1:]], dim=1)


class SeparatePositions(nn.Module):
    """Latents and context have a table each, so padding on either side moves nothing."""

    def __init__(self, latents: nn.Module, context: nn.Module) -> None:
        super().__init__()
        self.latents = latents
        self.context = context

    def forward(self, latents: Tensor, context: Tensor) -> tuple[Tensor, Tensor]:
        """Returns both with their positions added."""
        return self.latents(latents), self.context(context)


class SharedPositions(nn.Module):
    """One table over [latents, context], as in the paper's denoiser, or over [context, latents].

    The latter is that of the authors' diffusion on raw frames.
    """

    def __init__(self, table: nn.Module, latents_first: bool) -> None:
        super().__init__()
        self.table = table
        self.latents_first = latents_first

    def forward(self, latents: Tensor, context: Tensor) -> tuple[Tensor, Tensor]:
        """Returns both with their positions added."""
        if self.latents_first:
            return self.table(latents), self.table(context, latents.shape[1])
        return self.table(latents, context.shape[1]), self.table(context)


class InContext(nn.Module):
    """Latents and context are one sequence; attention does not care about its order."""

    def __init__(self, encoder: nn.Module) -> None:
        super().__init__()
        self.encoder = encoder

    def forward(
        self, latents: Tensor, mask: Tensor, context: Tensor, context_mask: Tensor
    ) -> Tensor:
        """Returns the latents' part of the encoder's output."""
        both = torch.cat([latents, context], dim=1)
        return self.encoder(both, torch.cat([mask, context_mask], dim=1))[:, : latents.shape[1]]


class AcrossContext(nn.Module):
    """Latents look at the context by cross-attention: the decoder as it is."""

    def __init__(self, decoder: nn.Module) -> None:
        super().__init__()
        self.decoder = decoder

    def forward(
        self, latents: Tensor, mask: Tensor, context: Tensor, context_mask: Tensor
    ) -> Tensor:
        """Returns the decoder's output."""
        return self.decoder(latents, mask, context, context_mask)


class DenoiserNetwork(nn.Module):
    """Projections around a transformer.

    The order in which parts are built is that in which a seed's numbers are drawn for them.

    Args:
        config: Which parts it has, and their sizes.
    """

    def __init__(self, config: DenoiserConfig) -> None:
        super().__init__()
        width, dropout = config.transformer.width, config.transformer.dropout
        inner, outer = (config.latent_width, width), (width, config.latent_width)
        # Latents to tokens of the transformer, and back.
        self.latents_in = nn.Linear(*inner) if config.project_latents else nn.Identity()
        self.latents_out = nn.Linear(*outer) if config.project_latents else nn.Identity()
        kind = config.condition_projection
        linear = nn.Linear(config.condition_width, width, bias=kind != "table")
        time = NumberEmbedding(config.sine_width, width, config.time_scale)
        length = NumberEmbedding(config.sine_width, width) if config.length_token else None
        tables = [transformer.position(config.position, width, dropout) for _ in range(2)]
        # Words of the condition to tokens.
        self.condition_in = {
            "relu_linear": nn.Sequential(nn.ReLU(), linear),
            "standardized": nn.Sequential(Standardization(config.condition_width), linear),
            "none": nn.Identity(),
        }.get(kind, linear)
        self.numbers = NumberTokens(time, length)
        # Whether words are added to the time's token, as in MDM (Tevet et al. 2023), rather than
        # tokens of their own; whether attention sees padded latents as well, a quirk of the
        # authors' diffusion on raw frames.
        self.adds_words = config.words == "added_to_time"
        self.attends_to_padding = config.attends_to_padding
        # Adds positions to latents and context.
        shared = SharedPositions(tables[0], config.positions == "latents_first")
        separate = config.positions == "separate"
        self.positions = SeparatePositions(*tables) if separate else shared
        # The transformer, called with latents, their mask, context and its mask.
        self.body: nn.Module = (
            AcrossContext(transformer.layer_stack(config.transformer, transformer.DecoderLayer))
            if config.attention == "cross"
            else InContext(transformer.layer_stack(config.transformer, transformer.EncoderLayer))
        )
        # Adds the step condition of a few-step student to the numbers.
        self.step_embedding = StepEmbedding(config.sine_width, width) if config.few_step else None

    def measure_words(self, words: Float[Tensor, "words width"]) -> None:
        """Shows the words of the training prompts to a projection that standardizes them."""
        for module in self.condition_in.modules():
            if isinstance(module, Standardization):
                module.measure(words)

    @property
    def further_inputs(self) -> tuple[str, ...]:
        """Additional inputs of a few-step student, by name; else none."""
        return self.step_embedding.inputs if self.step_embedding else ()

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
            step_condition: Guidance and step size for a few-step student, else None.
        """
        numbers = self.numbers(t.expand(z.shape[0]), mask)
        if self.step_embedding is not None:
            numbers = self.step_embedding(numbers, step_condition)
        words, words_mask = self.condition_in(condition.tokens), condition.mask
        if self.adds_words:
            weights = words_mask / words_mask.sum(dim=1, keepdim=True).clamp(min=1)
            words = (words * weights[..., None]).sum(dim=1, keepdim=True)
            numbers = torch.cat([numbers[:, :1] + words, numbers[:, 1:]], dim=1)
            words, words_mask = words[:, :0], words_mask[:, :0]
        always = torch.ones_like(numbers[..., 0], dtype=torch.bool)
        context = torch.cat([numbers, words], dim=1)
        context_mask = torch.cat([always, words_mask], dim=1)
        latents, context = self.positions(self.latents_in(z), context)
        attended = torch.ones_like(mask) if self.attends_to_padding else mask
        latents = self.body(latents, attended, context, context_mask)
        return self.latents_out(latents) * mask[..., None]


def forward_of(denoiser: DenoiserNetwork) -> Callable[..., Tensor]:
    """Returns a denoiser as a function of tensors alone: z, t, words, words_mask, mask.

    A distilled one has two more inputs, guidance and step_size.
    """

    def forward(
        z: Tensor,
        t: Tensor,
        words: Tensor,
        words_mask: Tensor,
        mask: Tensor,
        guidance: Tensor | None = None,
        step_size: Tensor | None = None,
    ) -> Tensor:
        distilled = guidance is not None and step_size is not None
        step_condition = StepCondition(guidance, step_size) if distilled else None
        return denoiser(z, t, Conditioning(words, words_mask), mask, step_condition)

    return forward
