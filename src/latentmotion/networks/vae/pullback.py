"""The pullback of a convolutional decoder: a gradient of features becomes one of latents, Jᵀ g.

The adjoint of every layer is written out, so that it can be exported as a graph and run without
automatic differentiation. The adjoint of a convolution has the same weights, the other way round.
One forward pass serves any number of gradients, the rows of a Jacobian.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor, nn

from latentmotion.model.vae_config import STRIDE
from latentmotion.networks.vae.convolutional import (
    Double,
    MaskedConvolution,
    ResidualBlock,
    Unfold,
    as_row,
    pyramid,
)
from latentmotion.networks.vae.interface import MotionVAE, decoder_modules

Adjoint = Callable[[Tensor], Tensor]
"""Gradient of a layer's output to the gradient of its input, (rows, steps, channels)."""


class Pullback(nn.Module):
    """The transposed Jacobian of a decoder at one motion's latents.

    Args:
        vae: Its decoder is differentiated.
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
            latents: Of one motion, in the VAE's scale.
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
        convolution: Its output has `groups` groups of channels.
        g: Gradients of the first channels of each group, (rows, steps, channels).
        groups: How many groups there are.
    """
    kernel, steps, dilation = convolution.kernel_size[0], g.shape[1], convolution.dilation[0]
    reach = kernel // 2 * dilation
    padded = F.pad(g, (0, 0, reach, reach))
    shifts = [2 * reach - n * dilation for n in range(kernel)]
    taps = torch.cat([padded[:, shift : shift + steps] for shift in shifts], dim=2)
    weight = convolution.weight.unflatten(0, (groups, -1))[:, : g.shape[2] // groups]
    return taps @ weight.permute(3, 0, 1, 2).flatten(0, 2)  # (kernel · channels, inputs)
