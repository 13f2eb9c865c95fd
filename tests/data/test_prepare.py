"""From recordings to a prepared folder: what is dropped, what is reported, what is merged."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from latentmotion.data.clip import Caption, Clip, Source, TaggedSentence
from latentmotion.data.dataset import Dataset
from latentmotion.data.pack_file import read_pack
from latentmotion.data.prepare import (
    MIN_FRAMES,
    Preparation,
    corrected,
    encode,
    encode_all,
    merge,
)
from latentmotion.data.recording import Dropped, EncodedRecording, Label, PosedRecording, Recording
from latentmotion.data.report import REPORT, Part, PreparationReport, parts_of, read_report
from latentmotion.data.sources import LABELS
from latentmotion.data.sources.snu import held_out
from latentmotion.data.store import MANIFEST, StoredClip, caption_rows, read_manifest
from latentmotion.errors import DataError, InputError
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.representation.smpl import SMPL_FEATURES
from tests.support.mocap_folders import swaying
from tests.support.moving_figures import joints_of

PACK = Path(__file__).parents[2] / "data" / "starter.pack"
MADE_UP = Source("made up", "CC0-1.0", "nobody")
LABEL = Label("a", "made up", "a.bvh", "train", (TaggedSentence("he steps left"),))


def encoded(name: str = "a", frames: int = 30, **changes) -> EncodedRecording:
    joints = joints_of(np.random.default_rng(len(name)), frames + 1)
    label = replace(LABEL, id=name, **changes)
    return EncodedRecording(label, HUMANML3D_FEATURES.encode(joints))


def prepared(folder: Path, *items: EncodedRecording | Dropped, notes: tuple[str, ...] = ()) -> Path:
    preparation = Preparation(HUMANML3D_FEATURES)
    preparation.add(items)
    preparation.write(folder, (MADE_UP,), notes=notes)
    return folder


def test_a_recording_becomes_one_frame_less_and_nearly_itself() -> None:
    joints = swaying(40, fps=20).joints()
    made = encode(Recording(LABEL, joints), HUMANML3D_FEATURES)
    assert isinstance(made, EncodedRecording) and made.features.shape == (39, 263)
    assert made.round_trip_mm is not None and made.round_trip_mm < 1


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda joints: joints[: MIN_FRAMES - 1], "9 frames, fewer than 10"),
        (lambda joints: joints[:0], "0 frames, fewer than 10"),
        (lambda joints: 100 * joints, "check the unit of length"),
        (lambda joints: np.where(np.arange(40)[:, None, None] == 7, np.nan, joints), "in frame 7"),
    ],
)
def test_what_cannot_be_encoded_is_dropped_with_a_reason(change, reason: str) -> None:
    recording = Recording(LABEL, change(swaying(40, fps=20).joints()))
    (dropped,) = encode_all([recording], HUMANML3D_FEATURES)
    assert isinstance(dropped, Dropped) and dropped.id == "a" and dropped.what == "clip"
    assert reason in dropped.reason


def test_what_was_dropped_before_stays_dropped() -> None:
    before = Dropped("b", "part", "why")
    assert list(encode_all([before], HUMANML3D_FEATURES)) == [before]


def test_sentences_of_train_clips_are_corrected() -> None:
    wrong = TaggedSentence("a person grabbed something with right hands and hanged on something")
    mirrored = replace(wrong, text=wrong.text.replace("right", "left"))
    right = TaggedSentence("the man is being acrobatic")
    label = replace(LABEL, id="008252", sentences=(right, wrong), mirrored_sentences=(mirrored,))
    assert corrected(label) == replace(label, sentences=(right,), mirrored_sentences=())
    assert corrected(replace(label, split="test")) == replace(label, split="test")
    soup = corrected(replace(LABEL, origin="79_42[24:224]", mirrored_sentences=LABEL.sentences))
    for sentences in (soup.sentences, soup.mirrored_sentences):
        assert sentences[-1] == TaggedSentence("a person eats soup with a spoon.")


def test_corrections_are_of_train_clips_that_the_pack_has() -> None:
    stored = read_pack(PACK)[0].manifest.clips
    clips = {clip.id: clip for clip in stored if clip.split == "train"}
    trials = {clip.origin.partition("[")[0] for clip in clips.values()}
    wrong, added = (LABELS["corrections"][name] for name in ("wrong", "added"))
    assert not {*wrong, *added} & {*held_out()}
    for name, texts in wrong.items():
        assert texts and not {*texts} & {row[0] for row in clips[name].captions}
    assert {*added} <= {*clips} | trials


def test_captions_are_fitted_and_mirrored_ones_kept(tmp_path: Path) -> None:
    sentences = TaggedSentence("he steps left"), TaggedSentence("late", "", 9.0, 10.0)
    mirrored = TaggedSentence("he steps right", "", 0.5, 9.0), sentences[1]
    one = encoded(sentences=sentences, mirrored_sentences=mirrored, action="l", mirrored_action="r")
    dataset = Dataset.load(prepared(tmp_path / "set", one))
    clip, copy = dataset.clips("train", mirrored=True)
    assert clip.captions == (Caption("he steps left", 0, 30),)
    assert copy.captions == (Caption("he steps right", 10, 30),)
    assert (clip.action, copy.action) == ("l", "r") and dataset.actions() == ["l"]
    report = read_report(tmp_path / "set")
    assert report is not None and len(report.dropped) == 1
    assert report.dropped[0].what == "caption" and "180 of 30 frames" in report.dropped[0].reason


@pytest.mark.parametrize(
    ("items", "message"),
    [
        ([], r"no clip can be used \(no clip found\)"),
        ([Dropped(n, "clip", "bad") for n in "abcd"], r"used \(a, b, c and 1 more: bad\)"),
        ([encoded(split="val"), encoded("b", split="test")], "no clip is in the train split"),
        ([encoded(), encoded()], "two clips are called 'a'"),
    ],
)
def test_nothing_half_written_where_nothing_can_be(
    tmp_path: Path, items: list[EncodedRecording | Dropped], message: str
) -> None:
    with pytest.raises(DataError, match=message):
        prepared(tmp_path / "set", *items)
    assert not list(tmp_path.iterdir())


def test_features_that_are_used_as_they_are_get_no_statistics(tmp_path: Path) -> None:
    poses = PosedRecording(LABEL, np.zeros((12, 72)), np.zeros((12, 3))).encode(hold=15)
    preparation = Preparation(SMPL_FEATURES)
    preparation.add([poses])
    preparation.write(tmp_path / "set", (MADE_UP,))
    dataset = Dataset.load(tmp_path / "set")
    assert "as they are" in dataset.manifest.normalizer.origin
    features = dataset.features(dataset.clips("train")[0])
    assert len(features) == 15
    np.testing.assert_array_equal(dataset.normalizer.normalize(features), features)
    with pytest.raises(DataError, match=r"cannot merge humanml3d and smpl; merge like with like"):
        merge([tmp_path / "set", prepared(tmp_path / "other", encoded())], tmp_path / "both")


@pytest.mark.parametrize(
    ("pose", "hold", "expected"),
    [
        (np.zeros((4, 72)), 0, 4),
        (np.zeros((4, 72)), 3, 4),
        (np.zeros((4, 72)), 9, 9),
        (np.zeros((0, 72)), 9, "no frame"),
        (np.full((4, 72), np.nan), 9, "not finite"),
    ],
)
def test_poses_are_held_at_their_last_frame(pose: np.ndarray, hold: int, expected) -> None:
    made = PosedRecording(LABEL, pose, np.cumsum(np.ones((len(pose), 3)), axis=0)).encode(hold)
    if isinstance(made, Dropped):
        assert str(expected) in made.reason
    else:
        assert len(made.features) == expected
        np.testing.assert_array_equal(made.features[3:], made.features[[3] * (expected - 3)])


def test_frames_to_hold_are_no_negative_number() -> None:
    with pytest.raises(InputError, match="--hold -1: expected a number of frames"):
        PosedRecording(LABEL, np.zeros((4, 72)), np.zeros((4, 3))).encode(-1)


def stored(name: str, source: str, split, frames: int, captions: int) -> StoredClip:
    rows = caption_rows([Caption(f"{n}", 0, frames) for n in range(captions)])
    return StoredClip(name, source, "", split, frames, 0, 0, rows, ())


def test_a_folder_has_a_page_for_the_hub(tmp_path: Path) -> None:
    written = prepared(tmp_path / "clips", encoded()) / "README.md"
    _, head, page = written.read_text(encoding="utf-8").split("---\n", 2)
    fields = yaml.safe_load(head)
    assert (fields["license"], fields["task_categories"]) == ("cc0-1.0", ["text-to-3d"])
    assert fields["size_categories"] == ["n<1K"] and fields["pretty_name"] == "clips"
    assert f"**{MADE_UP.name}**: {MADE_UP.license}. {MADE_UP.credit}" in page
    assert f"| {MADE_UP.name} | {LABEL.split} | 1 |" in page


def test_parts_count_clips_captions_and_hours(tmp_path: Path) -> None:
    clips = (
        stored("1", "own", "val", 36_000, 3),
        stored("2", "cmu", "train", 72_000, 1),
        stored("3", "own", "val", 18_000, 0),
    )
    manifest = read_manifest(prepared(tmp_path / "set", encoded()))
    assert parts_of(replace(manifest, clips=clips)) == (
        Part("cmu", "train", 1, 1, 1.0),
        Part("own", "val", 2, 3, 0.75),
    )


def test_a_report_in_words() -> None:
    parts = (Part("cmu", "train", 2, 3, 0.5), Part("own", "val", 1, 0, 0.25))
    dropped = tuple(
        Dropped(n, what, "why") for n, what in (("a", "clip"), ("b", "caption"), ("c", "clip"))
    )
    lines = PreparationReport(parts, dropped, 0.1234, ("a note",)).text().splitlines()
    assert [line.split() for line in lines[:4]] == [
        ["source", "split", "clips", "captions", "hours"],
        ["cmu", "train", "2", "3", "0.500"],
        ["own", "val", "1", "0", "0.250"],
        ["all", "3", "3", "0.750"],
    ]
    assert lines[4:] == [
        "dropped: 1 captions, 2 clips",
        "  clip a: why",
        "  caption b: why",
        "  clip c: why",
        "joints → features → joints: off by 0.123 mm at the most",
        "a note",
    ]
    assert PreparationReport((), (), None).text().splitlines()[2:] == ["dropped: nothing"]
    assert len({len(line) for line in lines[:4]}) == 1, "columns are aligned"


def test_merged_reports_are_of_all_folders(tmp_path: Path) -> None:
    first = prepared(tmp_path / "1", encoded(), Dropped("x", "clip", "1"), notes=("one",))
    second = prepared(tmp_path / "2", replace(encoded("bb"), round_trip_mm=0.5), notes=("two",))
    third = prepared(tmp_path / "3", replace(encoded("ccc"), round_trip_mm=0.25))
    (third / REPORT).unlink()
    report = merge([first, second, third], tmp_path / "all")
    assert report.notes == ("one", "two") and report.round_trip_mm == 0.5
    assert report.dropped == (Dropped("x", "clip", "1"),)
    assert report.parts == (Part("made up", "train", 3, 3, round(90 / 20 / 3600, 4)),)
    assert read_report(tmp_path / "all") == report and read_report(third) is None
    assert Dataset.load(tmp_path / "all").sources == (MADE_UP,)


def test_a_damaged_report_is_named(tmp_path: Path) -> None:
    (tmp_path / REPORT).write_text('{"parts": [], "dropped": [], "rount_trip_mm": 1}')
    with pytest.raises(InputError, match=r"report\.json: PreparationReport: unknown key 'rount"):
        read_report(tmp_path)


@pytest.mark.parametrize("mirrored", [False, True])
def test_more_captions_come_with_their_mirror_images(mirrored: bool) -> None:
    clip = stored("1", "own", "val", 40, 1).with_captions([("turns left", 3, 9), ("waves", 0, 40)])
    made: Clip = clip.clip(mirrored)
    first = () if mirrored else (Caption("0", 0, 40),)
    turned = "turns right" if mirrored else "turns left"
    assert made.captions == (*first, Caption(turned, 3, 9), Caption("waves", 0, 40))
    assert made.id == ("M1" if mirrored else "1") and made.mirrored is mirrored


def test_folders_are_replaced_only_by_their_like(tmp_path: Path) -> None:
    folder = prepared(tmp_path / "set", encoded())
    before = Dataset.load(folder).fingerprint
    prepared(folder, encoded("bb"))
    assert Dataset.load(folder).fingerprint != before
    (folder / MANIFEST).unlink()
    with pytest.raises(InputError, match=r"exists and has no manifest\.json"):
        prepared(folder, encoded())
