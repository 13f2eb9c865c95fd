"""MDM's checkpoints (Tevet et al. 2023) to model folders: diffusion on frames by a plain encoder.

Time and prompt are one token before the frames. Other than our own models, MDM sees zeros where
there is no prompt, and attends to the padding of its own batches; here padding is left out, as in
its code for one motion. It cuts sentences after 20 word pieces, which is not repeated here.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch

from latentmotion.convert import mld
from latentmotion.diffusion import parametrization, schedule
from latentmotion.diffusion.condition import TextConditioning, TextTask
from latentmotion.errors import InputError, ModelError
from latentmotion.model.config import DenoiserConfig, IdentityVAEConfig, Sampling
from latentmotion.networks import checkpoint

_TEXT_ENCODER = "openai/clip-vit-base-patch32"

# Shortest and longest motions that the models of sentences were trained on.
_FRAMES = (40, 196)

# Networks that a file may hold beside the denoiser, by the first part of their weights' names.
OTHERS = ("clip_model", "rot2xyz")

_STACK = "seqTransEncoder."


def is_mdm(weights: mld.Weights) -> bool:
    """Returns whether a file's weights are MDM's, by their names."""
    return "input_process.poseEmbedding.weight" in weights


def latent_model(weights: mld.Weights, path: Path, origin: mld.Origin) -> checkpoint.LatentModel:
    """Returns the model of MDM's weights.

    Args:
        weights: All tensors of the file; those of `OTHERS` are left out.
        path: The checkpoint, for the card and for error messages.
        origin: What the file does not state.

    Raises:
        ModelError: It is a variant with a decoder or a GRU, without a prompt, or a weight is
            missing or of another shape.
        InputError: The normalizer is missing or does not fit, or a setting is not MDM's.
    """
    others = ("activation", "norm", "text_activation", "predicts")
    if any(getattr(origin, name) != getattr(mld.Origin(), name) for name in others):
        raise InputError(
            f"{path} is MDM's, which predicts the sample by one kind of layers; leave --predicts, "
            "--activation, --norm and --text-activation out"
        )
    if not any(name.startswith(_STACK) for name in weights):
        raise ModelError(f"{path}: expected MDM's encoder (trans_enc); other variants are not read")
    width, features = mld.shape(weights, "input_process.poseEmbedding.weight")
    by_text = "embed_text.weight" in weights
    words, actions = ("embed_text.weight", 1), ("embed_action.action_embedding", 0)
    name, axis = words if by_text else actions
    config = DenoiserConfig(
        latent_width=features,
        condition_width=mld.shape(weights, name)[axis],
        transformer=mld.transformer(weights, _STACK, origin),
        condition_projection="linear" if by_text else "table",
        words="added_to_time",
        positions="context_first",
        position="sine",
        sine_width=width,
    )
    twice = "embed_timestep.sequence_pos_encoder.pe"
    used = {
        name: weight.float()
        for name, weight in weights.items()
        if name.split(".")[0] not in OTHERS and name != twice
    }
    # MDM's sinusoid of the time alternates sine and cosine; here all cosines come first.
    first = "embed_timestep.time_embed.0.weight"
    used[first] = torch.cat([used[first][:, 1::2], used[first][:, ::2]], dim=1)
    network = mld.loaded(lambda: checkpoint.build(config), used, ("mdm",), f"{path}, MDM")
    vae = IdentityVAEConfig(config.latent_width)
    origin = replace(origin, text_encoder=origin.text_encoder or _TEXT_ENCODER)
    card = mld.model_card(path, vae, config, origin)
    sentences = isinstance(card.condition, TextTask)
    if sentences:
        conditioning = TextConditioning(null="zeros")
        card = replace(card, condition=replace(card.condition, conditioning=conditioning))
    terms = "as its authors say (MDM's code is MIT; the data behind it has terms of its own)"
    card = replace(
        card,
        schedule=schedule.Cosine(origin.diffusion_steps),
        parametrization=parametrization.Sample(),
        sampling=Sampling(origin.diffusion_steps, 2.5, "ddpm"),
        frames=_FRAMES if sentences else card.frames,
        provenance=replace(card.provenance, license=terms),
    )
    return checkpoint.LatentModel(card, checkpoint.build(vae), network)
