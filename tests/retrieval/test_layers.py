"""Layers: arms of a gesture over a body, by bodies whose answer is known by construction."""

import numpy as np
import pytest

from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.retrieval.layers import is_gesture, layered, stands

NAMES = list(HUMANML3D.names)
FRAMES = 40


def body(arms_up=(), shift=(0.0, 0.0, 0.0), sinks=0.0, kicks=0.0):
    """A body that stands, with arms hanging or up."""
    at = {name: n for n, name in enumerate(NAMES)}
    joints = np.zeros((len(NAMES), 3))
    heights = {
        "pelvis": 0.95, "spine1": 1.05, "spine2": 1.2, "spine3": 1.3, "neck": 1.45, "head": 1.6,
    }  # fmt: skip
    for name, height in heights.items():
        joints[at[name], 1] = height
    for side, sign in (("left", 1), ("right", -1)):
        up = 1 if side in arms_up else -1
        places = {
            "hip": (0.1, 0.9), "knee": (0.1, 0.5), "ankle": (0.1, 0.08), "foot": (0.1, 0.02),
            "collar": (0.06, 1.4), "shoulder": (0.18, 1.4), "elbow": (0.18, 1.4 + 0.28 * up),
            "wrist": (0.18, 1.4 + 0.54 * up),
        }  # fmt: skip
        for name, (outward, height) in places.items():
            joints[at[f"{side}_{name}"], :2] = sign * outward, height
    joints = np.repeat(joints[None], FRAMES, axis=0) + np.array(shift)
    joints[FRAMES // 2 :, :, 1] -= sinks * (joints[FRAMES // 2 :, :, 1] > 0.7)
    joints[FRAMES // 2 :, at["left_ankle"], 1] += kicks
    return joints


def test_a_raised_arm_goes_over_and_the_hanging_one_stays():
    under, over = body(shift=(3.0, 0.4, 1.0)), body(arms_up=("right",))
    result, wrist = layered(under, over, NAMES), NAMES.index("right_wrist")
    assert result[:, wrist] == pytest.approx(over[:, wrist] + (3.0, 0.4, 1.0))
    others = [n for n in range(len(NAMES)) if not NAMES[n].startswith("right")]
    assert result[:, others] == pytest.approx(under[:, others])


def test_a_gesture_turns_with_the_chest():
    about = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # a quarter to the left
    over = body(arms_up=("left",))
    over[:, NAMES.index("left_wrist"), 2] += 0.2  # held forward
    wrist = layered(body() @ about.T, over, NAMES)[:, NAMES.index("left_wrist")]
    assert wrist == pytest.approx(over[:, NAMES.index("left_wrist")] @ about.T)


@pytest.mark.parametrize(
    ("joints", "gesture"),
    [(body(("left",)), True), (body(sinks=0.4), False), (body(kicks=0.5), False)],
)
def test_legs_stand_in_a_gesture(joints, gesture):
    assert is_gesture(joints, NAMES) == gesture


def test_who_sits_down_does_not_stand_any_more():
    assert stands(body(sinks=0.4), NAMES).tolist() == [True] * 20 + [False] * 20
