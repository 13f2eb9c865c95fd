"""A trained network with more latent channels: it answers as before until training uses the new.

What reads latents gives new channels no weight. What makes them begins at zero, except for the
VAE's means: the encoder shows something in the new channels, so that there is something to read.
"""

from __future__ import annotations

from torch import Tensor, nn

from latentmotion.errors import InputError


def start_from(network: nn.Module, trained: nn.Module, channels: int, before: int) -> None:
    """Gives a network the weights of a trained one, in place.

    Args:
        network: VAE or denoiser with fresh weights.
        trained: One with the same layers, but for the number of latent channels.
        channels: Latent channels of `network`.
        before: Latent channels of `trained`.

    Raises:
        InputError: They differ in more than the latent channels, or there were more of them.
    """
    fresh, given = network.state_dict(), trained.state_dict()
    if fresh.keys() != given.keys() or channels < before:
        raise InputError(
            "the model to start from has other layers, or more latent channels; use the preset and "
            "settings that it was trained with"
        )
    network.load_state_dict(
        {name: _widened(name, fresh[name], given[name], channels, before) for name in fresh}
    )


def _widened(name: str, fresh: Tensor, trained: Tensor, channels: int, before: int) -> Tensor:
    """Returns the trained weights, and those of new channels behind them."""
    if fresh.shape == trained.shape:
        return trained
    result, shapes = fresh.clone(), (tuple(fresh.shape), tuple(trained.shape))
    match shapes:
        case ((to, *_), (of, *_)) if (to, of) == (2 * channels, 2 * before):
            # The encoder's last layer: all means, then all log variances.
            result[channels:] = 0
            result[:before], result[channels : channels + before] = trained.chunk(2)
        case ((to, *_), (of, *_)) if (to, of) == (channels, before):
            result[before:] = 0
            result[:before] = trained
        case ((_, to, *_), (_, of, *_)) if (to, of) == (channels, before):
            result[:, before:] = 0
            result[:, :before] = trained
        case _:
            raise InputError(
                f"the model to start from has {name} of shape {shapes[1]}, expected {shapes[0]}; "
                "use the preset and settings that it was trained with"
            )
    return result
