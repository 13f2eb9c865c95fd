"""Whether a window shows a single action and nothing else that is worth telling."""

from __future__ import annotations

from dataclasses import dataclass

from latentmotion.describe.scene import Scene, told_kinds
from latentmotion.describe.single import SingleAction
from latentmotion.describe.strict_acts import ACT_CHECKS
from latentmotion.describe.strict_postures import POSTURE_CHECKS
from latentmotion.describe.strict_ways import CALM, WAY_CHECKS


@dataclass(frozen=True)
class Limits:
    """What a window of a kind may show besides."""

    also: frozenset[str] = frozenset()
    """Kinds of acts that may be told of it as well."""
    travel: float = 0.7
    """Most meters that the pelvis goes, either way."""
    turned: float = 45.0
    """Most degrees by which the heading changes."""


def _limits(also: str = "", travel: float = 0.7, turned: float = 45.0) -> Limits:
    return Limits(CALM | frozenset(also.split()), travel, turned)


_LIMITS = {
    "jump": _limits("jump hop squat raise walk arms_out bow", 4.0),
    "hop": _limits("hop knee balance raise walk", 4.0),
    "kick": _limits("kick knee balance raise walk", 1.8, 60),
    "punch": _limits("punch raise walk", 1.0, 60),
    "wave": _limits("wave raise touch_head arms_out walk", 1.0),
    "raise": _limits("raise arms_out touch_head", 0.5),
    "clap": _limits("clap raise", 0.6),
    "knee": _limits("knee balance raise walk", 0.9),
    "march": _limits("walk knee balance", 0.9),
    "jog_in_place": _limits("jog knee jump walk", 0.9),
    "jack": _limits("jack jump raise arms_out wave arm_circle", 0.9),
    "squat": _limits("squat stay_crouch raise arms_out", 0.5),
    "bow": _limits("bow stay_bend raise", 0.6),
    "pick_up": _limits("pick_up squat bow walk", 1.2, 70),
    "balance": _limits("balance knee raise arms_out kick", 0.6, 50),
    "arms_out": _limits("arms_out raise", 0.5),
    "hands_on_hips": _limits("hands_on_hips", 0.5),
    "touch_head": _limits("touch_head raise", 0.5),
    "arm_circle": _limits("arm_circle raise arms_out wave", 0.6),
    "sit_down": _limits("sit_down stay_sit knee balance bow", 1.0, 120),
    "sit": _limits("stay_sit sit_down", 0.3),
    "stand_up": _limits("stand_up stay_sit knee balance bow", 1.0, 90),
    "sit_floor": _limits("sit_down stay_floor floor stay_kneel kneel_down", 1.0, 120),
    "lie_down": _limits(
        "lie_down stay_lie stay_floor sit_down kneel_down crawl stay_kneel", 2.0, 150
    ),
    "lie": _limits("stay_lie crawl", 0.6, 60),
    "get_up": _limits("get_up stand_up stay_lie stay_floor stay_kneel sit_up crawl", 2.0, 150),
    "kneel": _limits("kneel_down stay_kneel stay_crouch knee balance", 1.0, 60),
    "crouch": _limits("stay_crouch squat", 0.6),
    "crawl": _limits("crawl walk stay_bend stay_kneel stay_crouch climb", 9, 60),
    "climb": _limits("climb walk", 6, 60),
    "stand": _limits("", 0.25, 20),
}


_CHECKS = ACT_CHECKS | POSTURE_CHECKS


def strictly(action: SingleAction, scene: Scene) -> SingleAction | None:
    """Returns the action as its window shows it, measured anew; None where it shows more, or less.

    Args:
        action: A candidate.
        scene: What is measured in its window alone.
    """
    check = WAY_CHECKS.get(action.kind)
    if check:
        return check(action, scene)
    limits, path = _LIMITS[action.kind], scene.facts.path
    if path.length > limits.travel or abs(path.turned) > limits.turned:
        return None
    if told_kinds(scene) - limits.also:
        return None
    return _CHECKS[action.kind](action, scene)
