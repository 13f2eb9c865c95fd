"""Gestures that are drawn: hands are where the table says, and the index that ships has them."""

import importlib.util
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from latentmotion.model.card import MOVES_FILE, SHIPPED
from latentmotion.representation.interface import representation_named
from latentmotion.retrieval.index import read_index

DATA = Path(__file__).parents[2] / "data"
TABLE = tomllib.loads((DATA / "gestures.toml").read_text("utf-8"))["gesture"]


def test_a_hand_is_led_to_its_target_and_back(monkeypatch):
    spec = importlib.util.spec_from_file_location("gestures", DATA / "gestures.py")
    assert spec and spec.loader
    gestures = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, gestures)
    spec.loader.exec_module(gestures)
    names = [*representation_named("humanml3d").skeleton.names]
    body = np.zeros((1, len(names), 3))
    for name, place in {
        "right_hip": (-0.1, 0.9, 0), "left_hip": (0.1, 0.9, 0), "neck": (0, 1.45, 0),
        "head": (0, 1.6, 0), "right_shoulder": (-0.2, 1.4, 0), "right_elbow": (-0.25, 1.12, 0),
        "right_wrist": (-0.25, 0.86, 0),
    }.items():  # fmt: skip
        body[:, names.index(name)] = place
    salute = TABLE[0]
    assert "salute" in salute["captions"][0]
    joints = gestures.draw(salute, np.repeat(body, 2, axis=0), names, 20.0)
    wrist, head = (joints[:, names.index(name)] for name in ("right_wrist", "head"))
    assert len(joints) == round(salute["seconds"] * 20)
    assert np.allclose(wrist[40] - head[40], (-0.12, 0.06, 0.10), atol=1e-6)  # right is -x
    assert np.allclose(joints[[0, -1]], body, atol=5e-3)  # an arm is never quite straight
    bones = [("right_shoulder", "right_elbow"), ("right_elbow", "right_wrist")]
    for start, end in bones:
        bone = joints[:, names.index(start)] - joints[:, names.index(end)]
        assert np.ptp(np.linalg.norm(bone, axis=1)) < 1e-6


@pytest.mark.parametrize("gesture", TABLE, ids=lambda gesture: gesture["captions"][0])
def test_the_index_that_ships_has_each_gesture(gesture):
    index = read_index(SHIPPED / "starter" / MOVES_FILE)
    captions = {caption.text: caption for caption in index.captions}
    assert all(text in captions for text in gesture["captions"])
    clip = index.clips[captions[gesture["captions"][0]].clip]
    assert clip.source == "gestures" and abs(clip.tokens / 5 - gesture["seconds"]) < 0.4
