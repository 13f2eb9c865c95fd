"""Repetitions of one act in a motion, each with its frames: what a count is measured by."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from latentmotion.language.claims import limits
from latentmotion.measure import limbs, whole_body
from latentmotion.measure.facts import BOTH, SIDES, Event
from latentmotion.measure.signals import Curve, Signals, measure, peaks, smooth

# Share of the swing of the act's repetitions by which another movement looks like one.
_WEAK = 0.4

# Frames around a repetition in which its swing is measured.
_NEAR = 8


def jumps(events: Iterable[Event]) -> list[Event]:
    """Returns the jumps and hops in which the pelvis rises; lifted feet alone are no jump."""
    return [event for event in events if event.amount >= limits("rise").get(event.kind, np.inf)]


def bends(dips: Iterable[Event], postures: Iterable[Event]) -> list[Event]:
    """Returns bows, reaches down, and stretches in which the trunk stays bent, by start."""
    bows = [event for event in dips if event.kind in ("bow", "pick_up")]
    held = [
        posture
        for posture in postures
        if posture.kind == "bend"
        and not any(bow.start < posture.end and posture.start < bow.end for bow in bows)
    ]
    return sorted([*bows, *held], key=lambda event: event.start)


@dataclass(frozen=True)
class Repetitions:
    """Number of repetitions of an act in a motion."""

    full: tuple[Event, ...]  # The repetitions, by start; steps may overlap.
    # Frames of movements that look like half a repetition, but are not counted.
    weak: tuple[int, ...]


def repetitions(
    joints: Float[np.ndarray, "frames 22 3"], act: str, side: str = ""
) -> Repetitions | None:
    """Finds the repetitions of an act.

    Args:
        joints: Positions of HumanML3D's joints at 20 frames per second, meters, y up.
        act: A name of `COUNTED`.
        side: `left`, `right` or `both`, or nothing for any.

    Returns:
        None where the act is done with another side, too.
    """
    signals = measure(joints)
    full = sorted(COUNTED[act](signals), key=lambda event: event.start)
    if side and any(event.side != side for event in full):
        return None
    curves = (
        {s: smooth(curve, 0.5) for s, curve in _CURVES[act](signals, side).items()} if full else {}
    )
    around = [slice(max(event.start - _NEAR, 0), event.end + _NEAR) for event in full]
    every = curves.values()
    spread = [max(float(np.ptp(curve[near])) for curve in every) for near in around if curves]
    drop = _WEAK * float(np.median(spread)) if spread else 0.0
    weak = {
        top
        for of_side, curve in curves.items()
        for top in peaks(curve - curve.min(), 0.0, drop)
        if not any(
            event.start - 3 <= top < event.end + 3
            for event in full
            if not of_side or event.side in ("", of_side, BOTH)
        )
    }
    return Repetitions(tuple(full), tuple(sorted(weak)))


def _airborne(signals: Signals) -> list[Event]:
    flights = limbs.flights_of(signals)
    return limbs.jumps_of(signals, flights, limbs.running_of(flights, signals))


def _dips(signals: Signals) -> tuple[list[Event], tuple[Event, ...]]:
    postures = whole_body.postures_of(signals)
    return whole_body.dips_of(signals, whole_body.changes_of(postures)), postures


def _of_sides(side: str, curve: Callable[[str], Curve]) -> dict[str, Curve]:
    """Returns the curve of a side, or those of both."""
    return {each: curve(each) for each in (SIDES if side in ("", BOTH) else (side,))}


def _hand(signals: Signals, side: str) -> Curve:
    return (signals.of(f"{side}_wrist") - signals.of(f"{side}_shoulder"))[:, 1]


# Acts whose repetitions can be counted, and what finds them.
COUNTED: Mapping[str, Callable[[Signals], list[Event]]] = {
    "jump": lambda signals: jumps(_airborne(signals)),
    "hop": lambda signals: [event for event in _airborne(signals) if event.kind == "hop"],
    "kick": limbs.kicks_of,
    "knee": lambda signals: limbs.knees_of(signals, limbs.kicks_of(signals)),
    "step": lambda signals: [Event("step", *frames) for frames in limbs.strides_of(signals)],
    "punch": limbs.punches_of,
    "clap": limbs.single_claps_of,
    "raise": limbs.raises_of,
    "squat": lambda signals: [event for event in _dips(signals)[0] if event.kind == "squat"],
    "bow": lambda signals: bends(*_dips(signals)),
    "jack": lambda signals: [
        event for event in whole_body.poses_of(signals) if event.kind == "jack"
    ],
}

# Signal that swings once with each repetition, for each side of a limb or for "".
_CURVES: Mapping[str, Callable[[Signals, str], dict[str, Curve]]] = {
    **dict.fromkeys(("jump", "hop"), lambda signals, _: {"": signals.joints[:, 0, 1]}),
    **{
        act: lambda signals, side, joint=joint: _of_sides(
            side, lambda one: signals.of(f"{one}_{joint}")[:, 1]
        )
        for act, joint in (("kick", "ankle"), ("knee", "knee"))
    },
    "step": lambda signals, _: {},
    "punch": lambda signals, side: _of_sides(
        side,
        lambda one: np.linalg.norm(
            signals.of(f"{one}_wrist") - signals.of(f"{one}_shoulder"), axis=1
        ),
    ),
    "raise": lambda signals, side: _of_sides(side, lambda one: _hand(signals, one)),
    "clap": lambda signals, _: {"": -limbs.hands_apart(signals)},
    "squat": lambda signals, _: {"": -signals.joints[:, 0, 1]},
    "bow": lambda signals, _: {"": signals.lean},
    "jack": lambda signals, _: {"": np.minimum(*(_hand(signals, side) for side in SIDES))},
}
