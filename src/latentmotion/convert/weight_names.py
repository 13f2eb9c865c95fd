"""Weight names: the authors' names of weights to this project's.

The authors pack queries, keys and values of every attention into `in_proj`; cross-attention here
keeps the queries apart. Fixed sine tables, which they store, are compared with the formula and
dropped.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import torch
from torch import Tensor

from latentmotion.errors import ModelError
from latentmotion.networks.embeddings import LEARNED_LENGTH, sine_rate, sines

Weights = dict[str, Tensor]
Rules = tuple[tuple[str, str], ...]

_LAYERS: Rules = (
    (r"\binput_blocks\.", "first."),
    (r"\bmiddle_block\.", "middle."),
    (r"\boutput_blocks\.", "last."),
    (r"\blinear_blocks\.", "joins."),
    (r"\bself_attn\.in_proj_", "attention.query_key_value."),
    (r"\bself_attn\.out_proj\.", "attention.output."),
    (r"\bmultihead_attn\.out_proj\.", "cross_attention.output."),
    (r"\blinear1\.", "feed_forward.0."),
    (r"\blinear2\.", "feed_forward.3."),
    (r"\bnorm1\.", "around_attention.norm."),
    (r"\bnorm3\.", "around_feed_forward.norm."),
)

MLD_VAE: Rules = (
    (r"^global_motion_token$", "summary"),
    (r"^query_pos_encoder\.pe$", "position.table"),
    (r"^query_pos_decoder\.pe$", "decoder.position.table"),
    (r"^skel_embedding\.", "frames_in."),
    (r"^final_layer\.", "frames_out."),
    (r"^dist_layer\.", "distribution.linear."),
    (r"^latent_pre\.", "narrow."),
    (r"^latent_post\.", "widen."),
    (r"^decoder\.(?!position)", "decoder.decoder."),
)

MLD_VAE_JOINT: Rules = (*MLD_VAE[:-1], (r"^decoder\.(?!position)", "decoder.encoder."))

ACTOR_VAE: Rules = (
    (r"^encoder\.skel_embedding\.", "frames_in."),
    (r"^decoder\.final_layer\.", "frames_out."),
    (r"^encoder\.sequence_pos_encoding\.pe$", "position.table"),
    (r"^decoder\.sequence_pos_encoding\.pe$", "decoder.position.table"),
    (r"^encoder\.seqTransEncoder\.", "encoder."),
    (r"^decoder\.seqTransDecoder\.", "decoder.decoder."),
)

_DENOISER: Rules = (
    (r"^time_embedding\.linear_1\.", "numbers.time.network.0."),
    (r"^time_embedding\.linear_2\.", "numbers.time.network.2."),
    (r"^emb_proj\.1\.", "condition_in.1."),
    (r"^emb_proj\.action_embedding$", "condition_in.weight"),
    (r"^(encoder|decoder)\.", r"body.\1."),
    (r"^pose_embd\.", "latents_in."),
    (r"^pose_proj\.", "latents_out."),
    (r"^latent_pre\.", "latents_in."),
    (r"^latent_post\.", "latents_out."),
)

DENOISER_IN_CONTEXT: Rules = (*_DENOISER, (r"^query_pos\.pe$", "positions.table.table"))

DENOISER_CROSS: Rules = (
    *_DENOISER,
    (r"^query_pos\.pe$", "positions.latents.table"),
    (r"^mem_pos\.pe$", "positions.context.table"),
)

LINEAR_TEXT: Rules = ((r"^emb_proj\.1\.", "condition_in."),)
"""Goes before the other rules if the text's projection has no activation before it."""


def rename(weights: Mapping[str, Tensor], rules: Rules) -> Weights:
    """Returns the weights of one network under this project's names and in its shapes.

    Raises:
        ModelError: A stored sine table differs from the formula.
    """
    weights = dict(weights)
    if "encoder.mu_token" in weights and "encoder.logvar_token" in weights:
        tokens = [weights.pop("encoder.mu_token"), weights.pop("encoder.logvar_token")]
        weights["summary"] = torch.stack(tokens)
    renamed: Weights = {}
    for name, tensor in weights.items():
        if name.endswith(("multihead_attn.in_proj_weight", "multihead_attn.in_proj_bias")):
            stem, kind = _rename(name, rules, {}).split("multihead_attn.in_proj_")
            width = tensor.shape[0] // 3
            renamed[f"{stem}cross_attention.query.{kind}"] = tensor[:width]
            renamed[f"{stem}cross_attention.key_value.{kind}"] = tensor[width:]
            continue
        reshaped = tensor.squeeze(1) if name.endswith(".pe") else tensor
        reshaped = reshaped.T if name.endswith("action_embedding") else reshaped
        renamed[_rename(name, rules, weights)] = reshaped
    for name, table in list(renamed.items()):
        if not name.endswith(".table") or table.shape[0] <= LEARNED_LENGTH:
            continue
        length, width = table.shape
        if not torch.allclose(table, sines(torch.arange(length), sine_rate(width)), atol=1e-3):
            raise ModelError(f"the fixed positions {name!r} are not the sine table of ACTOR")
        del renamed[name]
    return renamed


def _rename(name: str, rules: Rules, weights: Mapping[str, Tensor]) -> str:
    # The second norm of a layer follows cross-attention if there is a third.
    has_third = re.sub(r"\bnorm2\..*", "norm3.weight", name) in weights
    second = "around_cross_attention" if has_third else "around_feed_forward"
    for pattern, replacement in (*rules, *_LAYERS, (r"\bnorm2\.", f"{second}.norm.")):
        name = re.sub(pattern, replacement, name)
    return name
