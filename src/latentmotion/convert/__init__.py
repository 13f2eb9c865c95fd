"""Checkpoints of MLD's, MotionLCM's and MDM's code to model folders."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from latentmotion.convert import mdm, mld, reading
from latentmotion.errors import InputError, ModelError
from latentmotion.networks import checkpoint


def convert_checkpoint(
    path: str | Path, output: str | Path, origin: mld.Origin | None = None
) -> dict[str, int]:
    """Converts a checkpoint; writes the whole folder or nothing.

    Args:
        path: Lightning file, or a dictionary of tensors.
        output: The model folder to write.
        origin: What the file does not state.

    Returns:
        The number of ignored weights of other networks (evaluators, CLIP, SMPL), by network.

    Raises:
        ModelError: The file cannot be opened safely, or is no checkpoint of that code.
        InputError: The normalizer is missing or does not fit.
    """
    path, origin = Path(path), origin or mld.Origin()
    try:
        state = reading.read_checkpoint(path)
        if mdm.is_mdm(state):
            heads = Counter(name.split(".")[0] for name in state)
            others = {head: heads[head] for head in mdm.OTHERS if heads[head]}
            model = mdm.latent_model(state, path, origin)
        else:
            if origin.diffusion_steps != mld.Origin().diffusion_steps:
                raise InputError(f"{path} is not MDM's, so leave --diffusion-steps out")
            parts, others = reading.split_parts(state)
            if not any(parts.values()):
                prefixes = ", ".join(list(others)[:5]) or "nothing"
                raise ModelError(
                    f"{path} has no weights under 'vae.' or 'denoiser.'; found {prefixes}"
                )
            model = mld.latent_model(parts, path, origin)
        checkpoint.save_model(output, model)
        return others
    except (ValueError, IndexError, KeyError, RuntimeError) as error:  # of weights of other shapes
        raise ModelError(
            f"{path} is no checkpoint of MLD's or MDM's code ({error!r:.200})"
        ) from error
