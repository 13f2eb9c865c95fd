"""The describer on figures that do one known thing, on its own sentences, and on HDM05's clips."""

from __future__ import annotations

import tarfile
from pathlib import Path

import numpy as np
import pytest

from latentmotion.data.clip import mirror_words
from latentmotion.data.recording import Recording
from latentmotion.data.sources.hdm05 import hdm05_groups
from latentmotion.errors import InputError
from latentmotion.language.claims import Claim
from latentmotion.language.reading import claims_of
from latentmotion.measure.facts import Description
from latentmotion.measure.scene import describe
from latentmotion.ranking.agreement import check
from latentmotion.representation.canonical import canonicalize
from latentmotion.representation.humanml3d import HUMANML3D_FEATURES
from latentmotion.training.captioning.described import Windows, caption_windows, holds
from latentmotion.training.captioning.sentences import sentences
from tests.support.simple_motions import FPS, figure, mirrored, raised


def say(description: Description, count: int = 6) -> list[str]:
    return sentences(description, np.random.default_rng(0), count=count)


def test_a_left_turn_is_counterclockwise_seen_from_above() -> None:
    """From +z, where a body faces at rest, to +x, which is its left."""
    found = describe(figure(4, speed=1.0, turn=90))
    assert [turn.side for turn in found.turns] == ["left"]
    assert found.path.turned == pytest.approx(90, abs=8)
    assert describe(figure(4, speed=1.0, turn=-90)).turns[0].side == "right"


@pytest.mark.parametrize(
    ("way", "direction"), [(0, "forward"), (180, "backward"), (90, "left"), (-90, "right")]
)
def test_the_way_is_told_as_the_body_sees_it(way: float, direction: str) -> None:
    found = describe(figure(3, speed=0.9, way=way))
    assert {move.direction for move in found.moves} == {direction}
    assert all(direction in sentence or direction == "forward" for sentence in say(found))


@pytest.mark.parametrize(("turn", "side"), [(360, "left"), (-360, "right")])
def test_a_circle_is_called_a_circle_to_its_side(turn: float, side: str) -> None:
    found = describe(figure(8, speed=1.1, turn=turn))
    assert found.path.closed
    assert check(f"a person walks in a circle to the {side}", found).verdict == "agrees"
    other = mirror_words(f"a person walks in a circle to the {side}")
    assert check(other, found).verdict == "contradicts"
    assert any("circle" in sentence for sentence in say(found, 12))


def test_speed_makes_the_pace() -> None:
    slow, fast = describe(figure(4, speed=0.5)), describe(figure(4, speed=1.8))
    assert any("slow" in sentence for sentence in say(slow))
    assert check("a person walks slowly", fast).verdict == "contradicts"
    assert check("a person runs", slow).verdict == "contradicts"


def test_who_stands_still_is_told_so() -> None:
    found = describe(figure(3))
    assert found.activity < 0.01
    assert check("a person walks forward", found).verdict == "contradicts"
    assert all("stand" in sentence or "stay" in sentence for sentence in say(found))


def test_jumps_are_counted_with_where_they_happen() -> None:
    time = np.arange(100) / FPS
    phase = time % 2.0
    up = np.where(phase < 0.5, 4 * 0.35 * phase * (0.5 - phase) / 0.25, 0.0)
    found = describe(figure(5, height=0.92 + up))
    jumps = found.find("jump")
    assert len(jumps) == 3
    assert [jump.direction for jump in jumps] == ["place"] * len(jumps)
    assert check("someone jumps three times", found).verdict == "agrees"
    assert check("someone jumps once", found).verdict == "contradicts"


@pytest.mark.parametrize(("side", "axis"), [("left", 2.6), ("right", -2.6)])
def test_a_raised_hand_is_of_its_side(side: str, axis: float) -> None:
    joints = figure(3, swings={f"{side}_shoulder": raised(60, axis)})
    found = describe(joints)
    assert [event.side for event in found.find("raise")] == [side]
    assert check(f"a person raises their {side} hand", found).verdict == "agrees"
    other = "right" if side == "left" else "left"
    assert check(f"a person raises their {other} hand", found).verdict == "contradicts"


def test_a_mirrored_motion_has_the_mirrored_facts() -> None:
    joints = figure(5, speed=1.0, turn=120, swings={"left_shoulder": raised(100, 2.6)})
    one, other = describe(joints), describe(mirrored(joints))
    swap = {"left": "right", "right": "left"}
    assert [(e.kind, swap.get(e.side, e.side), e.start) for e in one.events] == [
        (e.kind, e.side, e.start) for e in other.events
    ]
    assert other.path.turned == pytest.approx(-one.path.turned, abs=0.1)
    assert other.path.left == pytest.approx(-one.path.left, abs=1e-3)


def test_sentences_are_repeatable_different_and_true() -> None:
    found = describe(figure(6, speed=1.1, turn=-180))
    first, again = (sentences(found, np.random.default_rng(3), count=8) for _ in range(2))
    assert first == again
    assert len(set(first)) == 8
    assert {check(sentence, found).verdict for sentence in first} == {"agrees"}


def test_a_given_caption_is_used_unless_the_motion_contradicts_it() -> None:
    found = describe(figure(4, speed=1.0))
    generator = np.random.default_rng(0)
    assert "an old man limps" in sentences(found, generator, action="an old man limps")
    assert "a person jumps" not in sentences(found, generator, action="a person jumps")


@pytest.mark.parametrize(
    ("sentence", "claims"),
    [
        ("a person walks backwards slowly", [Claim("walk", direction="backward", pace="slow")]),
        (
            "the man kicks twice with his left leg",
            [Claim("kick", side="left", count=2)],
        ),
        (
            "someone turns left by 90 degrees, then sits down",
            [Claim("turn", side="left", degrees=90), Claim("sit", then=True)],
        ),
        (
            "walk in a clockwise circle",
            [Claim("walk"), Claim("circle", side="right")],
        ),
        ("he turns the conditioning wheel to the left", [Claim("twist", side="left")]),
        ("a person does jumping jacks", []),
        ("she raises her right knee", [Claim("knee", side="right")]),
    ],
)
def test_claims_are_read_from_a_sentence(sentence: str, claims: list[Claim]) -> None:
    assert list(claims_of(sentence)) == claims


def test_order_that_is_told_is_compared() -> None:
    walk, stay = figure(3, speed=1.0), figure(3, swings={"left_shoulder": raised(60, 2.6)})
    stay = stay + (walk[-1, :1] - stay[:1, :1]) * np.array([1, 0, 1])
    found = describe(np.concatenate([walk, stay]))
    told = "a person walks forward, then raises the left hand"
    assert check(told, found).verdict == "agrees"
    turned = "a person raises the left hand, then walks forward"
    assert check(turned, found).verdict == "contradicts"
    assert not holds(told, found, describe(walk))
    assert holds("a person walks forward", found, describe(walk))


def test_windows_have_sentences_that_hold_there() -> None:
    joints = figure(9, speed=1.0, turn=-200)
    rows = caption_windows(
        joints, [("a person walks", 0, 180)], np.random.default_rng(1), Windows(count=6)
    )
    spans = {(start, end) for _, start, end in rows}
    assert len(spans) == 7
    assert all(0 <= start < end <= 180 and end - start >= 20 for start, end in spans)
    assert sum(text == "a person walks" for text, _, _ in rows) >= 5
    for text, start, end in rows:
        assert check(text, describe(joints[start:end])).verdict != "contradicts", text


@pytest.mark.parametrize(
    "joints", [np.zeros((40, 21, 3)), np.zeros((2, 22, 3)), np.full((40, 22, 3), np.nan)]
)
def test_what_is_no_motion_is_refused(joints: np.ndarray) -> None:
    with pytest.raises(InputError):
        describe(joints)


@pytest.mark.parametrize("seed", range(8))
def test_any_numbers_are_described_without_a_crash(seed: int) -> None:
    generator = np.random.default_rng(seed)
    joints = generator.normal(0, generator.choice([0.01, 1, 30]), (60, 22, 3)).cumsum(axis=0)
    assert say(describe(joints))
    assert say(describe(np.zeros((10, 22, 3))))


def test_hdm05_is_read_as_its_classes_say(shared: Path, tmp_path: Path) -> None:
    """Reliable sides: the names of HDM05's classes; table in lab/diary/describing.md."""
    expected = {"kickLFront": ("kick", "left"), "depositFloorR": ("pick_up", "right")}
    with tarfile.open(shared / "data/hdm05_asfamc.tar.xz") as tar:
        for member in tar:
            if member.name.endswith(".asf") or any(name in member.name for name in expected):
                tar.extract(member, tmp_path, filter="data")
    seen = right = 0
    for item in hdm05_groups(tmp_path)[0].read():
        assert isinstance(item, Recording)
        kind, side = next(acts for name, acts in expected.items() if name in item.label.id)
        joints = canonicalize(HUMANML3D_FEATURES.retarget(item.joints), HUMANML3D_FEATURES.skeleton)
        seen += 1
        right += any(one.side in (side, "both") for one in describe(joints).find(kind))
    assert seen > 50
    assert right >= 0.95 * seen


def test_a_verb_of_two_parts_doubles_its_last_letter() -> None:
    left = figure(4, speed=0.7, way=90)
    texts = sentences(describe(left), np.random.default_rng(0), count=200)
    going = [text for text in texts if "sidestepp" in text]
    assert going, texts[:5]
    assert not [text for text in texts if "sidesteping" in text]
