"""Whether postures follow each other in a window as an action says."""

from __future__ import annotations

from latentmotion.describe.facts import LEFT, RIGHT
from latentmotion.describe.poses import stillness
from latentmotion.describe.scene import Scene, highest_hand
from latentmotion.describe.single import SingleAction
from latentmotion.describe.strict_acts import Check


def _passing(kind: str) -> int:
    """Frames from which a posture between others is one of its own."""
    return 30 if kind in ("bend", "crouch") else 16


def _postures(*stages: str) -> Check:
    """Checks that postures follow each other so, short passing ones left out."""

    def check(action: SingleAction, scene: Scene) -> SingleAction | None:
        kept = [
            posture.kind
            for posture in scene.facts.postures
            if posture.kind in stages or posture.frames >= _passing(posture.kind)
        ]
        merged = [kind for n, kind in enumerate(kept) if n == 0 or kept[n - 1] != kind]
        return action if tuple(merged) == stages else None

    return check


def _rests(kind: str) -> Check:
    """Checks that a posture is all there is and that little moves."""

    def check(action: SingleAction, scene: Scene) -> SingleAction | None:
        alone = {posture.kind for posture in scene.facts.postures} == {kind}
        return action if alone and scene.facts.activity < 0.35 else None

    return check


def _seated(*stages: str) -> Check:
    """Checks postures of which one is on a seat, as high as a low stool at least."""

    def check(action: SingleAction, scene: Scene) -> SingleAction | None:
        high = float(scene.signals.joints[:, 0, 1].min()) > 0.35
        return _postures(*stages)(action, scene) if high else None

    return check


def _either(
    *checks: Check,
) -> Check:
    def check(action: SingleAction, scene: Scene) -> SingleAction | None:
        return next((found for one in checks if (found := one(action, scene))), None)

    return check


def _crawls(action: SingleAction, scene: Scene) -> SingleAction | None:
    held = sum(event.frames for event in scene.find("crawl"))
    return action if held > 0.8 * scene.facts.frames else None


def _climbs(action: SingleAction, scene: Scene) -> SingleAction | None:
    events = scene.find("climb")
    return action if [e.direction for e in events] == [action.direction] else None


def _stands(action: SingleAction, scene: Scene) -> SingleAction | None:
    still = stillness(scene.signals).mean() >= 0.85
    standing = all(posture.kind == "stand" for posture in scene.facts.postures)
    hands = max(highest_hand(scene, side) for side in (LEFT, RIGHT)) < -0.15
    return action if still and standing and hands else None


POSTURE_CHECKS: dict[str, Check] = {
    "sit_down": _seated("stand", "sit"),
    "sit": _seated("sit"), "stand_up": _seated("sit", "stand"),
    "sit_floor": _either(
        _postures("stand", "floor"), _postures("floor"), _postures("stand", "kneel", "floor")
    ),
    "lie_down": _either(
        _postures("stand", "lie"), _postures("stand", "floor", "lie"),
        _postures("stand", "kneel", "lie"),
    ),
    "lie": _rests("lie"),
    "get_up": _either(
        _postures("lie", "stand"), _postures("floor", "stand"), _postures("lie", "kneel", "stand"),
        _postures("lie", "floor", "stand"), _postures("floor", "kneel", "stand"),
    ),
    "kneel": _either(_postures("stand", "kneel"), _postures("kneel")),
    "crouch": _either(
        _postures("stand", "crouch"), _postures("crouch"), _postures("stand", "crouch", "stand")
    ),
    "crawl": _crawls, "climb": _climbs, "stand": _stands,
}  # fmt: skip
"""Checks by kind."""
