"""Sequences of two actions: the seam, the sentences, where they come from; only for training."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from latentmotion.cli.main import main
from latentmotion.data.clip import Source, Split, TaggedSentence, mirror_sentence
from latentmotion.data.dataset import Dataset
from latentmotion.data.prepare import Preparation, encode
from latentmotion.data.recording import EncodedRecording, Label, Recording
from latentmotion.data.store import COMPOSED, MANIFEST
from latentmotion.errors import DataError
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import HUMANML3D, Animation
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.representation.splicing import splice
from latentmotion.training.captioning.clauses import read_clauses
from latentmotion.training.captioning.compose import Composition, action_clips, compose
from latentmotion.training.captioning.rewording import in_order

CAPTIONS = {
    "wave": "a person waves with the left hand.",
    "kick": "someone kicks with the right leg.",
    "punch": "a man punches with his right hand.",
    "bow": "the person bows and stands up.",
    "several": "a person walks forward, then turns around and then waves.",
    "held": "a person claps once.",
    "tested": "a person throws a ball.",
}
SPLITS: dict[str, Split] = {"held": "val", "tested": "test"}


def action(seed: int, frames: int = 41) -> np.ndarray:
    """Joints of a figure that moves arms and spine and comes back to how it stood."""
    generator = np.random.default_rng(seed)
    angles = np.zeros((frames, len(HUMANML3D), 3))
    upper = [HUMANML3D.names.index(n) for n in ("left_shoulder", "right_elbow", "spine2", "neck")]
    shape = np.sin(np.pi * np.arange(frames) / (frames - 1)) ** 2
    angles[:, upper] = shape[:, None, None] * generator.uniform(-0.9, 0.9, (1, len(upper), 3))
    root = np.tile([[0.0, 0.95, 0.0]], (frames, 1))
    return Animation(HUMANML3D, matrix_from_axis_angle(angles), root, 20.0).joints()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    preparation = Preparation(HUMANML3D_FEATURES)
    for seed, (name, caption) in enumerate(CAPTIONS.items()):
        sentence = TaggedSentence(caption)
        split = SPLITS.get(name, "train")
        label = Label(
            name, "made", f"take-{name}", split, (sentence,), (mirror_sentence(sentence),)
        )
        encoded = encode(Recording(label, action(seed)), HUMANML3D_FEATURES)
        assert isinstance(encoded, EncodedRecording)
        preparation.add([encoded])
    out = tmp_path_factory.mktemp("compose") / "set"
    preparation.write(out, (Source("made", "CC0", "nobody"),))
    return out


def test_seam_is_smooth_and_the_first_motion_is_kept() -> None:
    first, second = action(0)[:25], action(1)[3:]
    turned = second @ np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]) + np.array([3.0, 0, -1])
    joints = splice(first, turned, 0.4, HUMANML3D_FEATURES)
    assert len(joints) == len(first) + len(second) - 1
    np.testing.assert_array_equal(joints[:24], first[:-1])
    np.testing.assert_allclose(joints[24], first[-1], atol=1e-6)
    steps = np.linalg.norm(np.diff(joints, axis=0), axis=-1)
    gap = np.linalg.norm(first[-1] - second[0], axis=-1).max()
    assert steps.max() < 0.4 * gap
    bones = joints[:, 1:] - joints[:, list(HUMANML3D.parents[1:])]
    assert np.ptp(np.linalg.norm(bones, axis=-1), axis=0).max() < 1e-6


def test_second_motion_is_untouched_after_the_transition() -> None:
    first, second = action(0), action(1)
    joints = splice(first, second, 0.4, HUMANML3D_FEATURES)
    after = joints[40 + 8 :]
    own = second[8:]
    distances = [np.linalg.norm(m[:, :, None] - m[:, None], axis=-1) for m in (after, own)]
    np.testing.assert_allclose(*distances, atol=1e-6)
    np.testing.assert_allclose(after[..., 1], own[..., 1], atol=1e-9)


def test_feet_that_stand_at_the_seam_stay() -> None:
    joints = splice(action(0), action(1), 0.4, HUMANML3D_FEATURES)
    feet = joints[:, [*HUMANML3D.left_foot, *HUMANML3D.right_foot]]
    assert np.ptp(feet, axis=0).max() < 0.01


def test_only_single_actions_of_the_train_split_are_parts(folder: Path) -> None:
    names = {part.name for part in action_clips(Dataset.load(folder))}
    single = ("wave", "kick", "punch", "bow")
    assert names == {f"{side}{name}" for name in single for side in ("", "M")}


def test_sequences_say_what_comes_first_and_where_from(folder: Path) -> None:
    composed = compose(Dataset.load(folder), Composition(count=10))
    assert len(composed.motions) == 10
    assert (composed.source.name, composed.source.license) == (COMPOSED, "CC0")
    for motion in composed.motions:
        clip = motion.clip
        assert clip.split == "train"
        assert len(motion.features) == clip.frames
        names = re.findall(r"M?(\w+)\[\d+:\d+\] \(made take-\1\)", clip.origin)
        assert len(names) == 2
        assert not {"held", "tested", "several"} & set(names)
        seam = min(end for _, _, end, _ in clip.captions)
        for text, start, end, _ in clip.captions:
            assert (start, end) in ((0, clip.frames), (0, seam), (seam, clip.frames))
            if (start, end) == (0, clip.frames):
                places = [text.find(names[0][:3]), text.rfind(names[1][:3])]
                assert 0 <= places[0] < places[1], text


def test_mirrored_sentences_have_the_other_side(folder: Path) -> None:
    for motion in compose(Dataset.load(folder), Composition(count=5)).motions:
        rows = zip(motion.clip.captions, motion.clip.mirrored_captions, strict=True)
        for (text, *span, _), (other, *same, _) in rows:
            assert span == same
            swapped = text.replace("left", "?").replace("right", "left").replace("?", "right")
            assert other == swapped


def test_command_writes_a_folder_that_merges(folder: Path, tmp_path: Path) -> None:
    for out in ("one", "two"):
        arguments = ["data", "compose", str(folder), "-o", str(tmp_path / out), "--count", "6"]
        main(arguments)
    one, two = ((tmp_path / out / MANIFEST).read_bytes() for out in ("one", "two"))
    assert one == two
    whole = str(tmp_path / "whole")
    main(["data", "merge", str(folder), str(tmp_path / "one"), "-o", whole])
    dataset = Dataset.load(whole)
    splits = {clip.split for clip in dataset.manifest.clips if clip.source == COMPOSED}
    assert splits == {"train"}
    assert COMPOSED in {source.name for source in dataset.sources}
    assert all(part.clip.source != COMPOSED for part in action_clips(dataset))


def test_synthetic_clip_in_a_test_set_is_refused(folder: Path, tmp_path: Path) -> None:
    main(["data", "compose", str(folder), "-o", str(tmp_path / "out"), "--count", "2"])
    path = tmp_path / "out" / MANIFEST
    manifest = json.loads(path.read_text())
    manifest["clips"][0]["split"] = "test"
    path.write_text(json.dumps(manifest))
    with pytest.raises(DataError, match="synthetic clip composed-0-00000 is in the split 'test'"):
        Dataset.load(tmp_path / "out")


def test_folder_without_single_actions_is_told(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("latentmotion.training.captioning.compose.action_clips", lambda dataset: [])
    with pytest.raises(DataError, match="0 train clips tell of a single action"):
        compose(Dataset.load(folder), Composition(count=1))


def test_order_is_told_in_many_ways() -> None:
    one, other = read_clauses("a person walks forward."), read_clauses("a man sits down")
    assert one is not None
    assert other is not None
    found = in_order(one, other, np.random.default_rng(0), 60)
    assert len(set(found)) == 60
    for text in found:
        assert re.search(r"walk.*(sit|seat).*", text), text
    assert any(text.startswith("after walking") for text in found)
    assert any(text.startswith("first walk") for text in found)
    assert any(" before " in text for text in found)
