"""Poses and exercises of the whole body beyond the describer's list, and stillness."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.describe.facts import BOTH, FPS, LEFT, RIGHT, Event
from latentmotion.describe.signals import JOINT, Signals, bend, closed_gaps, peaks, smooth, spans

HELD = 6
"""Frames of the shortest pose."""


def poses_of(signals: Signals) -> tuple[Event, ...]:
    """Returns `arms_out`, `hands_on_hips`, `touch_head`, `crawl` and `jack`, by start."""
    found = [
        *_held(signals, "arms_out", _out(signals, LEFT) & _out(signals, RIGHT), BOTH),
        *_held(signals, "hands_on_hips", _akimbo(signals, LEFT) & _akimbo(signals, RIGHT), BOTH),
        *_held(signals, "touch_head", _at_head(signals, LEFT), LEFT),
        *_held(signals, "touch_head", _at_head(signals, RIGHT), RIGHT),
        *_held(signals, "crawl", _on_all_fours(signals), ""),
        *_jacks(signals),
    ]
    return tuple(sorted(found, key=lambda event: event.start))


def stillness(signals: Signals, slowest: float = 0.25) -> Bool[np.ndarray, " frames"]:
    """Returns where no joint is faster than `slowest` meters per second."""
    velocity = np.gradient(smooth(signals.joints, 1.5), axis=0) * FPS
    return np.linalg.norm(velocity, axis=-1).max(axis=1) < slowest


def _held(
    signals: Signals, kind: str, where: Bool[np.ndarray, " frames"], side: str
) -> list[Event]:
    """Makes an event of every stretch that is long enough; short gaps do not end it."""
    return [Event(kind, a, b, side=side) for a, b in spans(closed_gaps(where, 4), HELD)]


def _out(signals: Signals, side: str) -> Bool[np.ndarray, " frames"]:
    """An arm is stretched out to its side, level with the shoulder."""
    shoulder, wrist = signals.of(f"{side}_shoulder"), signals.of(f"{side}_wrist")
    outward = (wrist - shoulder)[:, 0] * (1 if side == LEFT else -1)
    return (outward > 0.36) & (np.abs(wrist[:, 1] - shoulder[:, 1]) < 0.25)


def _akimbo(signals: Signals, side: str) -> Bool[np.ndarray, " frames"]:
    """A hand is at the hip, the elbow bent and away from the body."""
    hip, elbow, wrist = (signals.of(f"{side}_{part}") for part in ("hip", "elbow", "wrist"))
    near = np.linalg.norm(wrist - hip, axis=1) < 0.33
    return near & (_angle(signals, side) < 130) & (np.abs(elbow[:, 0]) > np.abs(wrist[:, 0]))


def _at_head(signals: Signals, side: str) -> Bool[np.ndarray, " frames"]:
    """A wrist is so near to the head that the hand is at it."""
    return np.linalg.norm(signals.of(f"{side}_wrist") - signals.of("head"), axis=1) < 0.24


def _on_all_fours(signals: Signals) -> Bool[np.ndarray, " frames"]:
    """The trunk is level, low and face down, hands and knees near the floor."""
    hands = np.maximum(signals.of("left_wrist")[:, 1], signals.of("right_wrist")[:, 1])
    knees = np.maximum(signals.of("left_knee")[:, 1], signals.of("right_knee")[:, 1])
    low = (signals.joints[:, 0, 1] < 0.7) & (hands < 0.4) & (knees < 0.45)
    return low & (signals.lean > 40) & (signals.lean < 140)


def _jacks(signals: Signals) -> list[Event]:
    """Feet go apart and arms up at once, and back."""
    feet = signals.joints[:, JOINT["left_ankle"]] - signals.joints[:, JOINT["right_ankle"]]
    apart = np.linalg.norm(feet[:, ::2], axis=1)
    arms = np.minimum(_raised(signals, LEFT), _raised(signals, RIGHT))
    tops = [t for t in peaks(arms, 0.0, 0.3) if _spread(apart, t)]
    return [Event("jack", max(t - 5, 0), min(t + 6, signals.frames), amount=0.0) for t in tops]


def _spread(apart: Float[np.ndarray, " frames"], top: int) -> bool:
    """Feet are far apart around a frame, and not long before or after."""
    near, around = apart[max(top - 5, 0) : top + 6], apart[max(top - 14, 0) : top + 15]
    return bool(near.max() > 0.4 and around.min() < near.max() - 0.15)


def _raised(signals: Signals, side: str) -> Float[np.ndarray, " frames"]:
    """Height of a wrist above its shoulder."""
    return signals.of(f"{side}_wrist")[:, 1] - signals.of(f"{side}_shoulder")[:, 1]


def _angle(signals: Signals, side: str) -> Float[np.ndarray, " frames"]:
    return bend(signals, f"{side}_shoulder", f"{side}_elbow", f"{side}_wrist")
