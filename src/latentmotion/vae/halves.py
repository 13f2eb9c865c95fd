"""The two halves of a VAE: what makes latents, and the way back, which can be another.

Latents are the same where the first half is, to the bit; a denoiser of these latents then fits.
"""

from __future__ import annotations

from hashlib import sha256
from itertools import takewhile

from torch import Tensor, nn

from latentmotion.vae.interface import MotionVAE


def way_back(vae: MotionVAE) -> nn.ModuleDict:
    """Returns the modules that turn latents into features, by name."""
    return nn.ModuleDict({name: getattr(vae, name) for name in vae.WAY_BACK})


def first_half(vae: MotionVAE) -> dict[str, Tensor]:
    """Returns all weights that make latents, by name."""
    weights = vae.state_dict().items()
    return {name: value for name, value in weights if name.partition(".")[0] not in vae.WAY_BACK}


def fingerprint(vae: MotionVAE) -> str:
    """Returns a hash of all weights that make latents; a zero has no sign in it."""
    found = sha256()
    for name, value in first_half(vae).items():
        found.update(name.encode() + (value + 0.0).cpu().contiguous().numpy().tobytes())
    return found.hexdigest()


def keep_latents(vae: MotionVAE, trained: MotionVAE) -> None:
    """Gives `vae` the first half of a trained one, frozen, and of its way back what is alike.

    Alike are the weights from the latents on, up to where name or shape differs.
    """
    own, given = (way_back(one).state_dict().items() for one in (vae, trained))
    pairs = takewhile(_are_alike, zip(own, given, strict=False))
    alike = {name: value for _, (name, value) in pairs}
    vae.load_state_dict({**vae.state_dict(), **first_half(trained), **alike})
    vae.requires_grad_(False)
    way_back(vae).requires_grad_(True)


def _are_alike(pair: tuple[tuple[str, Tensor], tuple[str, Tensor]]) -> bool:
    (one, own), (other, given) = pair
    return one == other and own.shape == given.shape
