"""Gestures that are drawn: hands are where the table says, and the index that ships has them."""

import importlib.util
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from latentmotion import MotionPipeline
from latentmotion.data.pack_file import read_pack
from latentmotion.model.card import MOVES_FILE, SHIPPED
from latentmotion.representation import representation_named
from latentmotion.retrieval.index import DRAWN, read_index
from latentmotion.retrieval.wordings import read_wordings
from latentmotion.storage.reading import unpack_xz

DATA = Path(__file__).parents[2] / "data"

BONES = ("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle")


@pytest.fixture
def gestures(monkeypatch):
    spec = importlib.util.spec_from_file_location("gestures", DATA / "gestures.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def drawn(gestures):
    """Returns the joints, by name, of a movement of the table on a body that stands."""
    names = [*representation_named("humanml3d").skeleton.names]
    body = np.zeros((1, len(names), 3))
    for name, place in {
        "pelvis": (0, 0.95, 0), "spine1": (0, 1.05, 0), "spine2": (0, 1.2, 0),
        "spine3": (0, 1.3, 0), "neck": (0, 1.45, 0), "head": (0, 1.6, 0), "hip": (0.1, 0.9, 0),
        "knee": (0.1, 0.49, 0.02), "ankle": (0.1, 0.08, -0.02), "foot": (0.12, 0.02, 0.1),
        "collar": (0.1, 1.4, 0), "shoulder": (0.2, 1.4, 0), "elbow": (0.25, 1.12, 0),
        "wrist": (0.25, 0.86, 0),
    }.items():  # fmt: skip
        for side, sign in ("", 1), ("left_", 1), ("right_", -1):
            if f"{side}{name}" in names:
                body[:, names.index(f"{side}{name}")] = np.array(place) * (sign, 1, 1)

    def draw(caption):
        rows = gestures.read_rows(DATA / "gestures.toml")
        gesture = next(one for one in rows if one["captions"][0] == caption)
        joints = gestures.draw(gesture, np.repeat(body, 2, axis=0), names, 20.0)
        assert len(joints) == round(gesture["seconds"] * 20) + 1
        for side in ("left", "right"):
            for start, end in BONES:
                rows = [names.index(f"{side}_{part}") for part in (start, end)]
                length = np.linalg.norm(np.diff(joints[:, rows], axis=1)[:, 0], axis=1)
                assert np.ptp(length) < 1e-6
        return {name: joints[:, n] for n, name in enumerate(names)}

    return draw


OWN = """
[[gesture]]
captions = ["a person does the secret club greeting", "the secret club hello"]
seconds = 2
right = [[0.2, "rest"], [0.9, "shoulder", 0, 0.05, 0.44], [1.8, "rest"]]
"""


def test_no_prompt_of_a_benchmark_is_fitted(gestures):
    def plain(text):
        return " ".join(re.findall(r"[\w'-]+", text.lower()))

    def rows_of(path):
        text = unpack_xz(path).decode() if path.suffix == ".xz" else path.read_text("utf-8")
        return [line.split("\t") for line in text.splitlines()]

    lists = DATA.parent / "benchmarks" / "quality"
    prompts = {
        plain(row[1])
        for name in ("movements", "terse")
        for row in rows_of(lists / f"{name}.tsv.xz")
    }
    prompts |= {plain(text) for row in rows_of(lists / "acts" / "acts.tsv")[1:] for text in row[4:]}
    for name in ("foreign", "known"):
        prompts |= {plain(row[-1]) for row in rows_of(lists / "acts" / f"{name}.tsv")[1:]}
    # The name of a movement that has been drawn since may be what was once foreign.
    fitted = [
        text for row in gestures.read_rows(DATA / "gestures.toml") for text in row["captions"][1:]
    ]
    wordings = read_wordings([DATA / "phrases.tsv.xz"]).values()
    fitted += [text for texts in wordings for text in texts]
    fitted += [row[1] for row in rows_of(DATA / "outside.tsv.xz")]
    assert len(prompts) > 2000 and not [text for text in fitted if plain(text) in prompts]


def test_the_pack_has_the_recordings(gestures):
    header, _ = read_pack(DATA / "starter.pack")
    assert {*gestures.RECORDINGS.values()} <= {clip.id for clip in header.manifest.clips}


def test_a_movement_of_ones_own_is_drawn_and_started_from(
    gestures, figures, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(gestures, "RECORDINGS", {"stand": "000"})
    (tmp_path / "own.toml").write_text(OWN)
    for _ in range(2):  # the second time it replaces what is there
        gestures.Gestures(tmp_path / "moves", table=tmp_path / "own.toml", data=figures).run()
        assert "1 movements" in capsys.readouterr().out
    own = MotionPipeline.from_pretrained("fast").with_moves(tmp_path / "moves")
    (choice,) = own.clip_starts.chooser.choices(own.read("does our secret club greeting"))
    assert "secret club" in choice.neighbors[0].caption.text
    assert own.read("the maestro leads the symphony").caption == "a person conducts an orchestra"


def test_a_hand_is_led_to_its_target_and_back(drawn):
    at = drawn("a person salutes")
    assert np.allclose(at["right_wrist"][40] - at["head"][40], (-0.12, 0.06, 0.10), atol=1e-6)
    ends = [name for name in at if "elbow" not in name and "knee" not in name]
    for name in ends:  # a limb is never quite straight
        assert np.allclose(at[name][[0, -1]], at[name][0], atol=6e-3)
    assert np.allclose(at["right_wrist"][0], (-0.25, 0.86, 0), atol=6e-3)


def test_feet_stay_on_the_floor_while_the_pelvis_sinks(drawn):
    at = drawn("a person does lunges")
    lowest = at["pelvis"][:, 1].argmin()
    assert at["pelvis"][lowest, 1] < 0.6
    assert np.allclose(at["right_ankle"][lowest], (-0.11, 0.08, 0.74), atol=1e-3)
    assert at["left_knee"][lowest, 1] < 0.2 and at["right_knee"][lowest, 1] > 0.4


def test_a_body_that_lies_is_as_low_as_the_floor(drawn):
    at = drawn("a person sleeps on the back")
    assert max(joint[:, 1].max() for joint in at.values()) < 0.75
    assert abs(at["head"][0, 1] - at["pelvis"][0, 1]) < 0.05


def test_the_index_that_ships_has_each_movement(gestures):
    index = read_index(SHIPPED / "starter" / MOVES_FILE)
    captions = {caption.text: caption for caption in index.captions if caption.support == DRAWN}
    for gesture in gestures.read_rows(DATA / "gestures.toml"):
        assert all(text in captions for text in gesture["captions"])
        clip = index.clips[captions[gesture["captions"][0]].clip]
        assert clip.id == gestures.name_of(gesture) != gestures.name_of({**gesture, "seconds": 9.9})
        assert clip.id == gestures.name_of({**gesture, "captions": ["other words"]})
        assert clip.source == "gestures" and abs(clip.tokens / 5 - gesture["seconds"]) < 0.4


def test_the_drawn_part_of_an_index_is_taken_out(gestures):
    index = read_index(SHIPPED / "starter" / MOVES_FILE)
    recorded = gestures.recorded(index)
    drawn = len(index.clips) - len(recorded.clips)
    assert drawn == len(gestures.read_rows(DATA / "gestures.toml"))
    assert not any(caption.support == DRAWN for caption in recorded.captions)
    for number in 0, len(recorded.captions) - 1:
        one, other = recorded.captions[number], index.captions[number - len(recorded.captions)]
        assert one.text == other.text and one.clip == other.clip - drawn
        assert np.array_equal(recorded.latents_of(one), index.latents_of(other))
    assert "crochet" not in str(recorded.words) and recorded.wordings.min() >= 0
