"""Configurations of motion VAEs, transformers, denoisers, few steps and sampling.

They are plain numbers that `networks.build` makes networks of; a card and a run folder keep them.

Each knows the latent space that it makes, itself in another size, and its lightest decoder, so that
nothing else needs to tell the families apart.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal, TypeVar

from latentmotion.diffusion.guidance import GuidanceRule
from latentmotion.diffusion.samplers import SamplerName
from latentmotion.errors import InputError
from latentmotion.storage import limits

# Position tables learned as in the paper, or sines as in ACTOR.
PositionKind = Literal["learned", "sine"]


def check_range(name: str, number: int, most: int, least: int = 1) -> None:
    """Raises InputError for a size that is not from `least` to `most`."""
    if not least <= number <= most:
        raise InputError(f"{name} {number}: expected {least} to {most:,}")


def check_dilations(name: str, dilations: tuple[int, ...]) -> None:
    """Raises InputError where there are too many dilations, or one is out of range."""
    check_range(name, len(dilations), limits.MOST_LAYERS)
    for dilation in dilations:
        check_range(name, dilation, limits.MOST_WIDTH)


@dataclass(frozen=True)
class TransformerConfig:
    """Size and shape of a stack; the defaults are the paper's.

    Raises:
        InputError: A size is out of range.
    """

    width: int = 256  # Numbers per token.
    layers: int = 9  # Number of layers, odd where there are skips.
    heads: int = 4  # Attention heads.
    hidden: int = 1024  # Width inside the feed-forward part.
    dropout: float = 0.1  # Share of numbers dropped in training.
    # Share of attention dropped in training; the authors drop 0.1, at a third of the speed.
    attention_dropout: float = 0.0
    activation: Literal["gelu", "relu"] = "gelu"  # Activation of the feed-forward part.
    # Whether a layer normalizes after or before each of its parts.
    norm: Literal["post", "pre"] = "post"
    skips: bool = True  # Whether first and last layers are joined.
    final_norm: bool = True  # Whether a last normalization closes the stack.

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
class FewStepConfig:
    """The step counts and guidance scales that a student learns.

    Raises:
        InputError: A number of steps does not divide that of the solver, or there is no range.
    """

    guidance: tuple[float, float] = (1.0, 6.0)  # Smallest and largest guidance scale.
    steps: tuple[int, ...] = (1, 2, 4)  # Numbers of steps in which it can be sampled.
    solver_steps: int = 16  # Steps of the teacher's solver, which all of these divide.

    def __post_init__(self) -> None:
        if not 1 <= self.solver_steps <= limits.MOST_STEPS or len(self.steps) > self.solver_steps:
            raise InputError(
                f"few_step.solver_steps {self.solver_steps}: expected 1 to {limits.MOST_STEPS:,}"
            )
        odd = [count for count in self.steps if count < 1 or self.solver_steps % count]
        if odd or not self.steps:
            stated = odd[0] if odd else "none"
            raise InputError(
                f"few_step.steps: {stated}; expected divisors of few_step.solver_steps, "
                f"{self.solver_steps}"
            )
        if not 0 <= self.guidance[0] <= self.guidance[1]:
            raise InputError(f"few_step.guidance {self.guidance}: expected the smaller scale first")

    def check(self, steps: int, guidance: float, sampler: str) -> None:
        """Raises InputError for sampling settings that the student has not learned."""
        smallest, largest = self.guidance
        if steps not in self.steps:
            choices = ", ".join(map(str, self.steps))
            raise InputError(f"{steps} sampling steps: this distilled model takes {choices}")
        if not smallest <= guidance <= largest:
            raise InputError(
                f"guidance {guidance:g}: this distilled model learned {smallest:g} to {largest:g}"
            )
        if sampler not in ("ddim", "euler"):
            raise InputError(f"sampler {sampler}: a distilled model is sampled with ddim alone")

    @property
    def stops(self) -> list[int]:
        """Numbers of the solver's timesteps at which some step begins or ends."""
        counts = self.steps
        return sorted(
            {n * self.solver_steps // count for count in counts for n in range(count + 1)}
        )


@dataclass(frozen=True)
class DenoiserConfig:
    """Which parts a `Denoiser` has; the defaults are ours, the presets have the paper's."""

    latent_width: int = 16  # Numbers per latent token.
    condition_width: int = 384  # Numbers per word of the condition.
    # The stack inside.
    transformer: TransformerConfig = field(
        default_factory=lambda: TransformerConfig(layers=5, hidden=1024)
    )
    # Whether a learned projection leads latents in and out; without, the widths must be equal.
    project_latents: bool = True
    # Projection of words; `table` is for one-hot labels, `relu_linear` is the paper's, which was
    # made for CLIP's embeddings; `standardized` brings those of any encoder to unit scale first.
    condition_projection: Literal["linear", "relu_linear", "standardized", "table", "none"] = (
        "linear"
    )
    # Whether words are tokens of their own, or added to the time's as in MDM.
    words: Literal["tokens", "added_to_time"] = "tokens"
    # Attention between latents and context.
    attention: Literal["in_context", "cross"] = "in_context"
    # Which positions share a table.
    positions: Literal["separate", "latents_first", "context_first"] = "separate"
    position: PositionKind = "learned"  # Kind of position table.
    sine_width: int = 256  # Width of the time's sinusoid.
    time_scale: float = 1.0  # Multiplies the time: 1 for discrete times, 1000 for times in 0 .. 1.
    # Whether the number of real latent tokens is an input of the network.
    length_token: bool = False
    # Whether attention sees padded latents, a quirk of the authors' diffusion on raw frames.
    attends_to_padding: bool = False
    # Entry point under `latentmotion.denoisers`, a function from this configuration to a network;
    # empty for `DenoiserNetwork`.
    plugin: str = ""
    # Step counts of a distilled model, which has guidance and step size as inputs; null for any
    # other.
    few_step: FewStepConfig | None = None

    def __post_init__(self) -> None:
        for name in ("latent_width", "condition_width", "sine_width"):
            check_range(name, getattr(self, name), limits.MOST_WIDTH)


@dataclass(frozen=True)
class Sampling:
    """Sampling settings that apply unless others are given."""

    steps: int = 50  # Sampling steps.
    guidance: float = 7.5  # Guidance scale (paper eq. 6).
    sampler: str = "ddim"  # Rule of a sampling step, of this package or of another.
    # Kind of guidance; a distilled model learned it from its teacher.
    guidance_rule: GuidanceRule = "classifier_free"

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
        changes = {"steps": steps, "guidance": guidance, "sampler": sampler}
        return replace(
            self, **{name: value for name, value in changes.items() if value is not None}
        )


STRIDE = 4  # Frames per latent token of a `ConvolutionalVAEConfig`.


@dataclass(frozen=True)
class LatentSpace:
    """Shape and scale of the latents.

    Raises:
        InputError: A size or scale is out of range.
    """

    width: int  # Numbers per token.
    tokens: int | None = None  # Tokens of any motion, for a VAE with a global latent.
    # Frames that one token stands for, for a VAE with latents over time.
    frames_per_token: int | None = None
    mean: tuple[float, ...] = (0.0,)  # Mean per channel; the denoiser sees (latent - mean) / std.
    std: tuple[float, ...] = (1.0,)  # Standard deviation per channel.

    def __post_init__(self) -> None:
        check_range("latents.width", self.width, limits.MOST_WIDTH)
        for name in ("tokens", "frames_per_token"):
            if (number := getattr(self, name)) is not None:
                check_range(f"latents.{name}", number, limits.MOST_TOKENS)
        fits = {len(self.mean), len(self.std)} <= {1, self.width}
        if not fits or not all(0 < scale < limits.MOST_NUMBER for scale in self.std):
            raise InputError("latents.mean and latents.std: expected a number, or one per channel")

    def tokens_of(self, frames: int) -> int:
        """Returns how many tokens a motion of so many frames has."""
        if self.frames_per_token is None:
            return self.tokens or 1
        return -(-frames // self.frames_per_token)


Config = TypeVar("Config", bound="MotionVAEConfig")


class MotionVAEConfig(ABC):
    """Interface of the configurations of all VAE families.

    Attributes:
        has_weights: Whether there is anything to train; false for diffusion on raw frames.
        sizes: Fields that are widths and lengths, checked as such; None is as good.
    """

    has_weights: ClassVar[bool] = True
    sizes: ClassVar[tuple[str, ...]] = ("features",)

    def __post_init__(self) -> None:
        for name in self.sizes:
            if (size := getattr(self, name)) is not None:
                check_range(f"vae.{name}", size, limits.MOST_WIDTH)

    @abstractmethod
    def latent_space(self) -> LatentSpace:
        """Returns shape of the latents; their scale is measured once the VAE is trained."""

    def scaled(self, width: int, layers: Mapping[int, int]) -> MotionVAEConfig:
        """Returns the same family in another size and without dropout, if it has a size.

        Args:
            width: Width inside.
            layers: New numbers of a transformer's layers by the old.
        """
        return self

    def for_data(self: Config, features: int, frames: int) -> Config:
        """Returns the configuration for so many features, and motions of at most so many frames."""
        return replace(self, features=features)  # type: ignore[type-var, call-arg]

    def with_light_decoder(self: Config) -> Config | None:
        """Returns the same latents with the decoder that costs least; None where there is none."""
        return None

    def decoder_margin(self) -> int | None:
        """Returns how many tokens to either side a decoded frame depends on; None for all."""
        return None

    def check_training(self, frames: int, batch_size: int) -> None:  # noqa: B027
        """Raises InputError where it can't learn from motions so long, or so few at once."""


@dataclass(frozen=True)
class TransformerVAEConfig(MotionVAEConfig):
    """Which parts a `TransformerVAE` has; the defaults are the paper's MLD-1."""

    sizes = ("features", "tokens", "latent_width")

    features: int = 263  # Numbers per frame.
    tokens: int = 1  # Latent tokens of a motion.
    # The stack inside, the same for encoder and decoder.
    transformer: TransformerConfig = field(default_factory=TransformerConfig)
    position: PositionKind = "learned"  # Kind of position tables.
    # Whether mean and logvar have tokens of their own or come from a linear layer.
    distribution: Literal["tokens", "linear"] = "tokens"
    # Whether frames look at the latents by cross-attention, share a sequence with them, or do the
    # first in most layers at a quarter of the frame rate.
    decoding: Literal["cross", "joint", "two_rate"] = "cross"
    # Layers of a decoder of two rates that see every frame; there are as many fewer coarse ones.
    fine_layers: int = 2
    # Numbers per latent token; by default as many as the transformer has.
    latent_width: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("vae.fine_layers", self.fine_layers + 1, limits.MOST_LAYERS)

    def latent_space(self) -> LatentSpace:
        """Returns tokens that each stand for the whole motion."""
        return LatentSpace(self.latent_width or self.transformer.width, tokens=self.tokens)

    def scaled(self, width: int, layers: Mapping[int, int]) -> TransformerVAEConfig:
        """Returns the same with a smaller or larger transformer."""
        transformer = replace(self.transformer.scaled(width, layers), dropout=0.0)
        return replace(self, transformer=transformer)

    def with_light_decoder(self) -> TransformerVAEConfig:
        """Returns the same latents with a decoder of two rates."""
        return replace(self, decoding="two_rate")


@dataclass(frozen=True)
class MirroredDecoder:
    """The encoder's way back: T/4 → T/2 → T, at full width."""

    def margin(self, dilations: tuple[int, ...]) -> int:
        """Returns how many tokens to either side a frame depends on, given the VAE's dilations."""
        frames = 1 + sum(dilations)  # at each of the three rates, with a convolution of its own
        return -(-(4 * frames + 2 * frames + 3) // 4)


@dataclass(frozen=True)
class QuarterRateDecoder:
    """Every layer at T/4, where a step costs a quarter of one at T; the last makes four frames."""

    # Dilation of each residual block; the first three are those of the mirrored decoder.
    dilations: tuple[int, ...] = (9, 3, 1, 1)

    def __post_init__(self) -> None:
        check_dilations("vae.decoder.dilations", self.dilations)

    def margin(self, dilations: tuple[int, ...]) -> int:
        """Returns how many tokens to either side a frame depends on."""
        return 2 + sum(self.dilations)


@dataclass(frozen=True)
class ConvolutionalVAEConfig(MotionVAEConfig):
    """Sizes of a `ConvolutionalVAE`."""

    sizes = ("features", "width", "channels")

    features: int = 263  # Numbers per frame.
    width: int = 256  # Channels inside.
    channels: int = 16  # Numbers per latent token.
    # Dilation of each residual block at half and at quarter rate.
    dilations: tuple[int, ...] = (1, 3, 9)
    # The decoder, from latent tokens to frames.
    decoder: MirroredDecoder | QuarterRateDecoder = field(default_factory=MirroredDecoder)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_dilations("vae.dilations", self.dilations)

    def latent_space(self) -> LatentSpace:
        """Returns latents over time, at a quarter of the frame rate."""
        return LatentSpace(self.channels, frames_per_token=STRIDE)

    def scaled(self, width: int, layers: Mapping[int, int]) -> ConvolutionalVAEConfig:
        """Returns the same with so many channels inside; latents and blocks stay."""
        return replace(self, width=width)

    def with_light_decoder(self) -> ConvolutionalVAEConfig:
        """Returns the same latents with a decoder at a quarter of the frame rate."""
        light = isinstance(self.decoder, QuarterRateDecoder)
        return self if light else replace(self, decoder=QuarterRateDecoder())

    def decoder_margin(self) -> int:
        """Returns the reach of the decoder's convolutions, in tokens."""
        return self.decoder.margin(self.dilations)


@dataclass(frozen=True)
class VPoserTConfig(MotionVAEConfig):
    """Sizes of a `VPoserT`; the defaults are the authors'."""

    sizes = ("features", "frames", "hidden", "width")

    features: int = 263  # Numbers per frame.
    frames: int = 196  # Length in frames, the same for all motions.
    hidden: int = 512  # Width of the layers inside.
    width: int = 256  # Numbers of the latent token.
    dropout: float = 0.1  # Share of numbers dropped in training.

    def latent_space(self) -> LatentSpace:
        """Returns the space of a single token for the whole motion."""
        return LatentSpace(self.width, tokens=1)

    def scaled(self, width: int, layers: Mapping[int, int]) -> VPoserTConfig:
        """Returns the same with a latent token of so many numbers, and twice that inside."""
        return replace(self, hidden=2 * width, width=width, dropout=0.0)

    def for_data(self, features: int, frames: int) -> VPoserTConfig:
        """Returns the same with `frames` as the one length."""
        return replace(self, features=features, frames=frames)

    def check_training(self, frames: int, batch_size: int) -> None:
        """Raises InputError for motions longer than the one length, or a batch of one."""
        self.check(frames)
        self.check_batch(batch_size)

    def check(self, frames: int) -> None:
        """Raises InputError for motions longer than the one length."""
        if frames > self.frames:
            raise InputError(
                f"{frames} frames: this VPoser-t knows motions of at most {self.frames}; show it "
                "shorter ones (--set vae_cropping.max_frames=… --set latents.cropping.max_frames=…)"
                " or train one with a greater vae.frames"
            )

    def check_batch(self, motions: int) -> None:
        """Raises InputError for a batch of training that cannot be normalized."""
        if motions < 2:
            raise InputError(
                "a batch of one motion: in VPoser-t's training the motions of a batch normalize "
                "each other; train on two or more at once (--set vae_training.batch_size=2)"
            )


@dataclass(frozen=True)
class IdentityVAEConfig(MotionVAEConfig):
    """No VAE, as in the paper's "MLD without VAE" and MDM: latents are the normalized frames."""

    has_weights: ClassVar[bool] = False

    features: int = 263  # Numbers per frame, and per latent token.

    def latent_space(self) -> LatentSpace:
        """Returns one token per frame."""
        return LatentSpace(self.features, frames_per_token=1)


@dataclass(frozen=True)
class PluginVAEConfig(MotionVAEConfig):
    """A VAE that another package adds, under `latentmotion.vaes`."""

    plugin: str  # Name of its entry point, which is called with `features` and the settings.
    features: int = 263  # Numbers per frame.
    # Shape of its latents.
    space: LatentSpace = field(default_factory=lambda: LatentSpace(256, tokens=1))
    settings: dict[str, Any] = field(default_factory=dict)  # Further keyword arguments.

    def latent_space(self) -> LatentSpace:
        """Returns the shape that the configuration states."""
        return self.space


# Every kind of VAE that a card or an experiment can name.
VAEConfig = (
    TransformerVAEConfig
    | ConvolutionalVAEConfig
    | VPoserTConfig
    | IdentityVAEConfig
    | PluginVAEConfig
)
