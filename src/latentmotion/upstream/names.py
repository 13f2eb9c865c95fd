"""The authors' names of weights become ours.

Theirs pack queries, keys and values of every attention into `in_proj`; our cross-attention keeps
the queries apart. Fixed sine tables, which they store, are compared with the formula and dropped.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import torch
from torch import Tensor

from latentmotion.errors import ModelError
from latentmotion.nn.position import LEARNED_LENGTH, sine_rate, sines

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
    (r"^query_pos_encoder\.pe$", "place.table"),
    (r"^query_pos_decoder\.pe$", "decoder.place.table"),
    (r"^skel_embedding\.", "frames_in."),
    (r"^final_layer\.", "frames_out."),
    (r"^dist_layer\.", "distribution.linear."),
    (r"^latent_pre\.", "narrow."),
    (r"^latent_post\.", "widen."),
    (r"^decoder\.(?!place)", "decoder.decoder."),
)

MLD_VAE_JOINT: Rules = (*MLD_VAE[:-1], (r"^decoder\.(?!place)", "decoder.encoder."))

ACTOR_VAE: Rules = (
    (r"^encoder\.skel_embedding\.", "frames_in."),
    (r"^decoder\.final_layer\.", "frames_out."),
    (r"^encoder\.sequence_pos_encoding\.pe$", "place.table"),
    (r"^decoder\.sequence_pos_encoding\.pe$", "decoder.place.table"),
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

DENOISER_IN_CONTEXT: Rules = (*_DENOISER, (r"^query_pos\.pe$", "places.table.table"))

DENOISER_CROSS: Rules = (
    *_DENOISER,
    (r"^query_pos\.pe$", "places.latents.table"),
    (r"^mem_pos\.pe$", "places.context.table"),
)

LINEAR_TEXT: Rules = ((r"^emb_proj\.1\.", "condition_in."),)
"""Goes before the others where nothing precedes the text's projection."""


def rename(weights: Mapping[str, Tensor], rules: Rules) -> Weights:
    """Returns the weights of one network under our names and in our shapes."""
    weights = _join_actor_tokens(dict(weights))
    renamed: Weights = {}
    for name, tensor in weights.items():
        if name.endswith("multihead_attn.in_proj_weight") or name.endswith("in_proj_bias"):
            renamed |= _split_projection(name, tensor, rules)
        else:
            renamed[_rename(name, rules, weights)] = _reshape(name, tensor)
    return _without_sine_tables(renamed)


def _rename(name: str, rules: Rules, weights: Mapping[str, Tensor]) -> str:
    # The second norm of a layer follows cross-attention where there is a third.
    has_third = re.sub(r"\bnorm2\..*", "norm3.weight", name) in weights
    second = "around_cross_attention" if has_third else "around_feed_forward"
    for pattern, ours in (*rules, *_LAYERS, (r"\bnorm2\.", f"{second}.norm.")):
        name = re.sub(pattern, ours, name)
    return name


def _split_projection(name: str, tensor: Tensor, rules: Rules) -> Weights:
    if ".multihead_attn." not in name:
        return {_rename(name, rules, {}): tensor}
    stem, kind = _rename(name, rules, {}).split("multihead_attn.in_proj_")
    width = tensor.shape[0] // 3
    return {
        f"{stem}cross_attention.query.{kind}": tensor[:width],
        f"{stem}cross_attention.key_value.{kind}": tensor[width:],
    }


def _reshape(name: str, tensor: Tensor) -> Tensor:
    if name.endswith(".pe"):
        return tensor.squeeze(1)
    return tensor.T if name.endswith("action_embedding") else tensor


def _join_actor_tokens(weights: Weights) -> Weights:
    if "encoder.mu_token" in weights and "encoder.logvar_token" in weights:
        tokens = [weights.pop("encoder.mu_token"), weights.pop("encoder.logvar_token")]
        weights["summary"] = torch.stack(tokens)
    return weights


def _without_sine_tables(weights: Weights) -> Weights:
    kept = {}
    for name, tensor in weights.items():
        if not name.endswith(".table") or tensor.shape[0] <= LEARNED_LENGTH:
            kept[name] = tensor
        elif not torch.allclose(tensor, _sine_table(*tensor.shape), atol=1e-3):
            raise ModelError(f"the fixed positions {name!r} are not the sine table of ACTOR")
    return kept


def _sine_table(length: int, width: int) -> Tensor:
    return sines(torch.arange(length), sine_rate(width))
