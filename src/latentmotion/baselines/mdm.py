"""MDM's network (Tevet et al. 2023): raw frames and one token of the time and the sentence.

    [time + sentence, frames] + sine positions → 8 post-norm layers, no skips → frames

Two things differ from MDM's code: without a condition it sees the embedding of the empty sentence,
as all our models do, where MDM sees zeros; and attention leaves padding out, where MDM's sees it.
"""

from __future__ import annotations

from latentmotion.model.config import DenoiserConfig, TransformerConfig


def mdm_denoiser(features: int, condition_width: int) -> DenoiserConfig:
    """The network for HumanML3D has 17.9 million weights."""
    return DenoiserConfig(
        latent_width=features,
        condition_width=condition_width,
        transformer=TransformerConfig(
            width=512, layers=8, heads=4, hidden=1024, skips=False, final_norm=False
        ),
        words="added_to_time",
        places="context_first",
        position="sine",
        sine_width=512,
    )
