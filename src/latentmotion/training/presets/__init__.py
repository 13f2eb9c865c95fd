"""Experiments ready to train: functions that return one."""

from __future__ import annotations

from collections.abc import Callable

from latentmotion.errors import InputError, hint
from latentmotion.training.experiment import Experiment
from latentmotion.training.presets.baselines import actor, mdm, mdm_50, mld_no_vae, vposer_t
from latentmotion.training.presets.flow import fast, fast_tokens, starter
from latentmotion.training.presets.mld import mld_humanact12, mld_humanml3d, mld_uestc

PRESETS: dict[str, Callable[[], Experiment]] = {
    "starter": starter,
    "fast": fast,
    "fast_tokens": fast_tokens,
    "mld_humanml3d": mld_humanml3d,
    "mld_humanact12": mld_humanact12,
    "mld_uestc": mld_uestc,
    "actor": actor,
    "vposer_t": vposer_t,
    "mld_no_vae": mld_no_vae,
    "mdm": mdm,
    "mdm_50": mdm_50,
}


def preset_named(name: str) -> Experiment:
    """Returns a preset.

    Raises:
        InputError: There is none of this name; the nearest is named.
    """
    if name not in PRESETS:
        raise InputError(f"unknown preset {name!r}; {hint(name, PRESETS)}")
    return PRESETS[name]()
