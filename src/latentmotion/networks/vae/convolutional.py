"""A VAE of 1-D convolutions at a quarter of the frame rate, and its decoder's derivatives.

    features (T, 263) → width 256 at T → T/2 → T/4 → latents (T/4, channels), and back

It is not the paper's: it learns the same motions some ten times faster from little data, and its
latents can be edited, joined and streamed. A length that is no multiple of four is padded inside
and cropped. After each convolution the padding is set to zero, which is what a convolution sees
beyond the ends of a motion alone, so padding has no effect. The decoder is a part of its own, so
that the same latents can get a cheaper one.

The adjoint of every layer is written out, so that it can be exported as a graph and run without
automatic differentiation. The adjoint of a convolution has the same weights, the other way round.
One forward pass serves any number of gradients, the rows of a Jacobian.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn

from latentmotion.model.config import (
    STRIDE,
    ConvolutionalVAEConfig,
    MirroredDecoder,
    QuarterRateDecoder,
)
from latentmotion.networks.vae.interface import (
    Features,
    FrameMask,
    Latents,
    MotionVAE,
    Posterior,
    TokenMask,
    decoder_modules,
)


class Chain(nn.ModuleList):
    """Layers one after the other, each with the mask of the rate that it leaves."""

    def forward(self, x: Tensor, masks: list[Tensor]) -> Tensor:
        """Returns what the last layer makes, (batch, channels, steps).

        Args:
            x: Input of the first layer, (batch, channels, steps).
            masks: True on real steps, at the rate of `x` and at those that follow.
        """
        rate = 0
        for layer in self:
            rate += layer.rate_change  # type: ignore[operator]
            x = layer(x, as_row(masks[rate]))
        return x


class MaskedConvolution(nn.Module):
    """Convolution that keeps the length, and zeroes the padding."""

    rate_change = 0

    def __init__(self, inputs: int, outputs: int, activation: nn.Module | None = None) -> None:
        super().__init__()
        self.activation = activation or nn.Identity()
        self.convolution = nn.Conv1d(inputs, outputs, 3, padding=1)

    def forward(self, x: Tensor, row: Tensor) -> Tensor:
        """Returns (batch, outputs, frames)."""
        return self.convolution(self.activation(x)) * row


class ResidualBlock(nn.Module):
    """x + what a dilated and a pointwise convolution find in it."""

    rate_change = 0

    def __init__(self, width: int, dilation: int) -> None:
        super().__init__()
        self.dilated = nn.Conv1d(width, width, 3, padding=dilation, dilation=dilation)
        self.pointwise = nn.Conv1d(width, width, 1)
        nn.init.zeros_(self.pointwise.weight)

    def forward(self, x: Tensor, row: Tensor) -> Tensor:
        """Returns the same shape; what is zero stays so, so only the bias needs masking."""
        return x + self.pointwise(F.silu(self.dilated(F.silu(x)))) * row


class Halve(nn.Module):
    """Convolution with stride 2."""

    rate_change = 1

    def __init__(self, width: int) -> None:
        super().__init__()
        self.convolution = nn.Conv1d(width, width, 4, stride=2, padding=1)

    def forward(self, x: Tensor, row: Tensor) -> Tensor:
        """Returns half the length."""
        return self.convolution(x) * row


class Double(nn.Module):
    """Every step twice, then a convolution that smooths the stairs."""

    rate_change = 1

    def __init__(self, width: int) -> None:
        super().__init__()
        self.convolution = nn.Conv1d(width, width, 3, padding=1)

    def forward(self, x: Tensor, row: Tensor) -> Tensor:
        """Returns twice the length."""
        return self.convolution(x[..., None].expand(-1, -1, -1, 2).flatten(2) * row) * row


class Unfold(nn.Module):
    """Convolution at a quarter of the frame rate that makes a step's four frames at once.

    Shi et al. 2016 have it for pixels, as the sub-pixel convolution.
    """

    rate_change = 2

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.convolution = nn.Conv1d(inputs, STRIDE * outputs, 3, padding=1)

    def forward(self, x: Tensor, row: Tensor) -> Tensor:
        """Returns four times the length."""
        frames = self.convolution(F.silu(x)).unflatten(1, (STRIDE, -1))
        return frames.permute(0, 2, 3, 1).flatten(2) * row


def pyramid(mask: FrameMask) -> list[Tensor]:
    """Returns masks at full, half and quarter rate, padded to a multiple of `STRIDE` frames."""
    full = F.pad(mask, (0, -mask.shape[1] % STRIDE))
    return [full, full[:, ::2], full[:, ::4]]


def as_row(mask: Bool[Tensor, "batch steps"]) -> Float[Tensor, "batch 1 steps"]:
    """Returns what a layer multiplies its output with."""
    return mask[:, None, :].float()


# Bound on the posterior's log variance; a rare motion far off the mean once made it infinite.
MAX_LOGVAR = 8.0


class ConvolutionalVAE(MotionVAE):
    """Residual convolutions with two halvings of the frame rate, and a way back.

    Args:
        config: Sizes, and the kind of decoder.
    """

    def __init__(self, config: ConvolutionalVAEConfig) -> None:
        super().__init__()
        channels, width, features = config.channels, config.width, config.features

        def blocks(dilations: Sequence[int]) -> list[ResidualBlock]:
            return [ResidualBlock(width, dilation) for dilation in dilations]

        encoder: list[nn.Module] = [
            MaskedConvolution(features, width),
            Halve(width),
            *blocks(config.dilations),
            Halve(width),
            *blocks(config.dilations),
            MaskedConvolution(width, 2 * channels, activation=nn.SiLU()),
        ]
        decoder: list[nn.Module] = [MaskedConvolution(channels, width)]
        match config.decoder:
            case MirroredDecoder():
                dilations = config.dilations[::-1]
                decoder += [*blocks(dilations), Double(width), *blocks(dilations), Double(width)]
                decoder.append(MaskedConvolution(width, width, activation=nn.SiLU()))
                decoder.append(MaskedConvolution(width, features, activation=nn.SiLU()))
            case QuarterRateDecoder(dilations):
                decoder += [*blocks(dilations), Unfold(width, features)]
        # Features to mean and logvar of the latents, T → T/2 → T/4; latents to features.
        self.encoder, self.decoder, self.latent_width = Chain(encoder), Chain(decoder), channels

    def encode(self, features: Features, mask: FrameMask) -> Posterior:
        """Returns the distribution of ceil(frames / 4) latent tokens."""
        masks = pyramid(mask)
        padding = masks[0].shape[1] - mask.shape[1]
        x = F.pad(features, (0, 0, 0, padding)).transpose(1, 2) * as_row(masks[0])
        mean, logvar = self.encoder(x, masks).transpose(1, 2).chunk(2, dim=-1)
        return Posterior(mean, logvar.clamp(max=MAX_LOGVAR))

    def decode(self, latents: Latents, mask: FrameMask) -> Features:
        """Returns features of as many frames as the mask has."""
        masks = pyramid(mask)
        x = latents.transpose(1, 2) * as_row(masks[-1])
        return self.decoder(x, masks[::-1]).transpose(1, 2)[:, : mask.shape[1]]

    def latent_mask(self, mask: FrameMask) -> TokenMask:
        """Returns True for a token whose first frame is real."""
        return mask[:, ::STRIDE]


# Gradient of a layer's output to the gradient of its input, (rows, steps, channels).
Adjoint = Callable[[Tensor], Tensor]


class Pullback(nn.Module):
    """The transposed Jacobian of a decoder at one motion's latents.

    Args:
        vae: VAE whose decoder is differentiated.
    """

    def __init__(self, vae: MotionVAE) -> None:
        super().__init__()
        (self.decoder,) = decoder_modules(vae).values()

    def forward(
        self,
        latents: Float[Tensor, "1 tokens width"],
        mask: Bool[Tensor, "1 frames"],
        gradient: Float[Tensor, "rows frames first_features"],
    ) -> Float[Tensor, "rows tokens width"]:
        """Returns the gradients of the latents.

        Args:
            latents: Latents of one motion, in the VAE's scale.
            mask: True on real frames.
            gradient: Gradients of normalized features; the features after the first are 0.
        """
        masks, adjoints, rate = pyramid(mask)[::-1], [], 0
        x = latents.transpose(1, 2) * as_row(masks[0])
        for layer in self.decoder.children():
            rate += layer.rate_change  # type: ignore[operator]
            row = as_row(masks[rate])
            adjoints.append(_adjoint(layer, x, row))
            x = layer(x, row)
        g = F.pad(gradient, (0, 0, 0, -mask.shape[1] % STRIDE))
        for adjoint in reversed(adjoints):
            g = adjoint(g)
        return g * as_row(masks[0]).mT


def _adjoint(layer: nn.Module, x: Tensor, row: Tensor) -> Adjoint:
    """Returns the adjoint of a layer at its input `x`."""
    column = row.mT
    if isinstance(layer, MaskedConvolution):
        derivative = 1.0 if isinstance(layer.activation, nn.Identity) else _silu_derivative(x)
        return lambda g: _turned(layer.convolution, g * column) * derivative
    if isinstance(layer, ResidualBlock):
        outer, inner = _silu_derivative(x), _silu_derivative(layer.dilated(F.silu(x)))

        def residual(g: Tensor) -> Tensor:
            bent = _turned(layer.pointwise, g * column) * inner
            return g + _turned(layer.dilated, bent) * outer

        return residual
    if isinstance(layer, Double):

        def halved(g: Tensor) -> Tensor:
            pairs = _turned(layer.convolution, g * column) * column
            return pairs.unflatten(1, (-1, 2)).sum(2)

        return halved
    assert isinstance(layer, Unfold), layer
    derivative = _silu_derivative(x)

    def folded(g: Tensor) -> Tensor:
        frames = (g * column).unflatten(1, (-1, STRIDE)).flatten(2)
        return _turned(layer.convolution, frames, STRIDE) * derivative

    return folded


def _silu_derivative(x: Tensor) -> Tensor:
    """Returns the derivative of SiLU, channels last."""
    gate = torch.sigmoid(x)
    return (gate * (1 + x * (1 - gate))).mT


def _turned(convolution: nn.Conv1d, g: Tensor, groups: int = 1) -> Tensor:
    """Returns the adjoint of a convolution, as one matrix product over all rows and steps.

    Args:
        convolution: Convolution whose output channels fall into `groups` groups.
        g: Gradients of the first channels of each group, (rows, steps, channels).
        groups: Number of groups.
    """
    kernel, steps, dilation = convolution.kernel_size[0], g.shape[1], convolution.dilation[0]
    reach = kernel // 2 * dilation
    padded = F.pad(g, (0, 0, reach, reach))
    shifts = [2 * reach - n * dilation for n in range(kernel)]
    taps = torch.cat([padded[:, shift : shift + steps] for shift in shifts], dim=2)
    weight = convolution.weight.unflatten(0, (groups, -1))[:, : g.shape[2] // groups]
    return taps @ weight.permute(3, 0, 1, 2).flatten(0, 2)  # (kernel · channels, inputs)
