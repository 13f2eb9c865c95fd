"""Joints → all windows that show one action alone."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain

import numpy as np
from jaxtyping import Float

from latentmotion.describe.scene import Scene, scene_of
from latentmotion.describe.single import SingleAction
from latentmotion.describe.single_acts import acts
from latentmotion.describe.single_ways import ways
from latentmotion.describe.strictness import strictly

SHORTEST, LONGEST = 16, 196
"""Frames of the shortest and of the longest window."""


def single_actions(
    joints: Float[np.ndarray, "frames 22 3"],
    generator: np.random.Generator,
    kinds: frozenset[str] | None = None,
) -> list[SingleAction]:
    """Returns windows that show one action and nothing else worth telling.

    Args:
        joints: As `describe` takes them.
        generator: What draws margins; another draw gives other windows of the same actions.
        kinds: Kinds that are wanted; all by default.
    """
    if len(joints) < SHORTEST:
        return []
    scene = scene_of(joints)
    found: dict[tuple[str, int, int], SingleAction] = {}
    windows: dict[tuple[int, int], Scene] = {}
    for one in chain(ways(scene, generator), acts(scene, generator)):
        action = _whole_units(one)
        key = (action.kind, action.start, action.end)
        if kinds is not None and action.kind not in kinds:
            continue
        if key in found or not SHORTEST <= action.frames <= LONGEST:
            continue
        window = (action.start, action.end)
        if window not in windows:
            windows[window] = scene_of(joints[action.start : action.end])
        checked = strictly(action, windows[window])
        if checked:
            found[key] = checked
    return list(found.values())


def _whole_units(action: SingleAction) -> SingleAction:
    """Cuts a window to a multiple of four frames, which training shows whole."""
    return replace(action, end=action.start + action.frames // 4 * 4)
