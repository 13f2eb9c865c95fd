"""Curves and their intervals: what every measurement of the describer is made of."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from latentmotion.measure.facts import Description, Event, FloorPath
from latentmotion.measure.signals import (
    around_peak,
    bearing,
    bend,
    closed_gaps,
    intervals,
    measure,
    monotone_intervals,
    peaks,
    smooth,
    spans,
    valley,
    without_short_intervals,
)
from tests.support import acted

MASKS = st.lists(st.booleans(), min_size=1, max_size=40).map(lambda row: np.array(row, bool))
CODES = st.lists(st.integers(0, 3), min_size=1, max_size=40).map(np.array)


def mask(text: str) -> np.ndarray:
    return np.array([one == "#" for one in text])


def codes(text: str) -> np.ndarray:
    return np.array([int(one) for one in text])


@pytest.mark.parametrize(
    ("text", "shortest", "found"),
    [
        ("....", 1, []),
        ("####", 1, [(0, 4)]),
        ("#..##.#", 1, [(0, 1), (3, 5), (6, 7)]),
        ("#..##.#", 2, [(3, 5)]),
    ],
)
def test_spans(text: str, shortest: int, found: list[tuple[int, int]]) -> None:
    assert list(spans(mask(text), shortest)) == found


@settings(max_examples=30)
@given(MASKS)
def test_spans_make_up_the_mask(values: np.ndarray) -> None:
    again = np.zeros(len(values), bool)
    for start, end in spans(values):
        assert not again[max(start - 1, 0) : end].any()
        again[start:end] = True
    assert (again == values).all()


@pytest.mark.parametrize(
    ("text", "longest", "filled"),
    [
        ("#.#..#", 1, "###..#"),
        ("#.#..#", 2, "######"),
        ("..#.#..", 3, "..###.."),
        ("....", 9, "...."),
    ],
)
def test_only_short_gaps_inside_are_closed(text: str, longest: int, filled: str) -> None:
    given_mask = mask(text)
    assert (closed_gaps(given_mask, longest) == mask(filled)).all()
    assert (given_mask == mask(text)).all()  # the argument stays as it is


@pytest.mark.parametrize(
    ("curve", "least", "drop", "tops"),
    [
        ([0, 1, 0], 0.5, 0.5, [1]),
        ([0, 1, 0], 1.5, 0.5, []),
        ([0, 1, 0.8, 1.2, 0], 0.5, 0.5, [3]),
        ([0, 1, 0.2, 1.2, 0], 0.5, 0.5, [1, 3]),
        ([1, 0, 1], 0.5, 0.5, []),
        ([0, 1, 0.8, 0.9], 0.5, 0.5, [1]),
        ([0, 0, 0], 0.0, 0.1, []),
    ],
)
def test_peaks_stand_out_on_both_sides(
    curve: list[float], least: float, drop: float, tops: list[int]
) -> None:
    assert peaks(np.array(curve, float), least, drop) == tops


@pytest.mark.parametrize("count", [1, 2, 5])
def test_every_hill_has_a_peak(count: int) -> None:
    curve = np.abs(np.sin(np.linspace(0, np.pi * count, 40 * count + 1)))
    assert peaks(curve, 0.5, 0.5) == [40 * n + 20 for n in range(count)]


@settings(max_examples=30)
@given(CODES)
def test_intervals_are_runs_of_equal_codes(values: np.ndarray) -> None:
    runs = intervals(values)
    assert [start for start, _ in runs[1:]] == [end for _, end in runs[:-1]]
    assert (runs[0][0], runs[-1][1]) == (0, len(values))
    assert all(len(set(values[start:end].tolist())) == 1 for start, end in runs)
    assert all(values[end - 1] != values[end] for _, end in runs[:-1])


@pytest.mark.parametrize(
    ("text", "shortest", "weak", "result"),
    [
        ("0001000", 2, None, "0000000"),
        ("0001222", 2, None, "0000222"),
        ("0001222", 2, 0, "0002222"),
        ("1000", 2, None, "0000"),
        ("01", 3, None, "11"),
        ("2", 5, None, "2"),
    ],
)
def test_short_runs_get_the_code_before_them(
    text: str, shortest: int, weak: int | None, result: str
) -> None:
    assert (without_short_intervals(codes(text), shortest, weak) == codes(result)).all()


@settings(max_examples=30)
@given(CODES, st.integers(1, 8))
def test_no_short_run_is_left(values: np.ndarray, shortest: int) -> None:
    cleaned = without_short_intervals(values, shortest)
    runs = intervals(cleaned)
    assert len(runs) == 1 or min(end - start for start, end in runs) >= shortest
    assert set(cleaned.tolist()) <= set(values.tolist())


@pytest.mark.parametrize(
    ("curve", "runs"),
    [
        ([0, 1, 2, 3, 4, 5], [(0, 5)]),
        ([5, 4, 3, 2, 1, 0], [(0, 5)]),
        ([0, 2, 4, 6, 4, 2, 0], [(0, 3), (3, 6)]),
        ([0, 2, 4, 3.5, 5, 6], [(0, 5)]),
        ([1, 1.2, 0.9, 1], []),
    ],
)
def test_rises_and_falls(curve: list[float], runs: list[tuple[int, int]]) -> None:
    assert monotone_intervals(np.array(curve, float), 1.0) == runs


@pytest.mark.parametrize(
    ("left", "ahead", "direction"),
    [
        (0, 1, "forward"),
        (1, 1.1, "forward"),
        (1, 0.5, "left"),
        (-1, -0.5, "right"),
        (1, -2, "backward"),
        (0, -1, "backward"),
    ],
)
def test_bearing(left: float, ahead: float, direction: str) -> None:
    assert bearing(left, ahead) == direction


def test_the_surroundings_of_a_peak() -> None:
    curve = np.array([0, 0, 1, 2, 3, 2, 0.5, 0.0])
    assert around_peak(curve, 4, 1.5) == (2, 6)
    assert around_peak(curve, 4, -1) == (-1, 8)
    assert valley(curve, 4) == (2, 6)
    two = np.array([0, 2, 1.2, 4, 1.0, 0])
    assert valley(two, 1) == (0, 2)  # a higher peak follows: the valley ends between them


def test_smoothing_keeps_level_and_mean() -> None:
    step = np.repeat([0.0, 1.0], 20)
    smoothed = smooth(step, 2.0)
    assert np.diff(smoothed).min() >= -1e-12
    assert (smoothed[0], smoothed[-1]) == pytest.approx((0, 1), abs=1e-6)
    assert smoothed.mean() == pytest.approx(0.5)
    assert smooth(np.full((9, 22, 3), 2.5), 3.0) == pytest.approx(2.5)


@pytest.mark.parametrize("heading", [0, 60, 170, -120])
def test_the_body_frame_turns_with_the_body(heading: float) -> None:
    signals = measure(acted.elsewhere(acted.stand(), heading))
    assert np.degrees(signals.heading) == pytest.approx(heading)
    assert signals.of("left_shoulder")[0] == pytest.approx([0.195, 1.37, 0], abs=1e-4)
    assert signals.of("pelvis")[-1] == pytest.approx([0, acted.STANDING, 0], abs=1e-4)


def test_the_heading_has_no_jumps_of_a_full_turn() -> None:
    heading = np.degrees(measure(acted.walk(8, 1.0, turn=720)).heading)
    assert np.abs(np.diff(heading)).max() < 10
    assert heading[-1] == pytest.approx(720, abs=6)


@pytest.mark.parametrize("lean", [-30.0, 0.0, 45.0, 80.0])
def test_lean_is_forward_and_tilt_is_any(lean: float) -> None:
    signals = measure(acted.Body(frames=10, lean=lean).joints())
    assert signals.lean == pytest.approx(lean, abs=1e-6)
    assert signals.tilt == pytest.approx(abs(lean), abs=0.01)


def test_the_angle_of_a_joint() -> None:
    signals = measure(acted.knee_up("left"))
    angles = bend(signals, "left_hip", "left_knee", "left_ankle")
    assert angles[0] > 165 and angles.min() < 90
    assert bend(signals, "right_hip", "right_knee", "right_ankle").min() > 165


def test_an_event_shares_frames_with_another() -> None:
    one, other = Event("a", 0, 10), Event("b", 14, 20)
    assert (one.overlap(other), one.overlap(other, 6), other.overlap(other)) == (0, 2, 6)
    assert (one.frames, one.seconds) == (10, 0.5)


def test_facts_are_found_by_kind() -> None:
    path = FloorPath(1, 1, 0, 1, 0, 0, False)
    events = (Event("kick", 9, 12, "both", "side"), Event("kick", 0, 4, "left", count=3))
    moves = (Event("walk", 0, 5, direction="left"), Event("stand", 5, 20))
    found = Description(20, path, moves, (), (Event("stand", 0, 20),), events, 0)
    assert [event.start for event in found.find("kick")] == [0, 9]
    assert found.find("kick") == events[::-1] and found.find("walk") == moves[:1]
    assert [event.start for event in found.find("stand")] == [0, 5]  # the posture, and the move
    assert found.find("hop") == () and found.seconds == 1
