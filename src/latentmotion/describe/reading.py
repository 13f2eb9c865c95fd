"""Joints → description: all measurements of one motion, put together."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from latentmotion.describe.arms import arm_circles_of, claps_of, punches_of, raises_of, waves_of
from latentmotion.describe.facts import Description, Event
from latentmotion.describe.legs import (
    balances_of,
    climbs_of,
    flights_of,
    jumps_of,
    kicks_of,
    knees_of,
    running_of,
    steps_of,
    treading_of,
)
from latentmotion.describe.postures import changes_of, dips_of, postures_of
from latentmotion.describe.signals import activity_of, measure, twist_of
from latentmotion.describe.travel import moves_of, path_of, turns_of


def describe(joints: Float[np.ndarray, "frames joints 3"]) -> Description:
    """Measures what a motion does.

    Args:
        joints: Positions of HumanML3D's 22 joints at 20 frames per second, meters, y up, the
            floor at zero; the body as large as HumanML3D's (pelvis at 0.92 m when it stands).

    Raises:
        InputError: The joints have another shape, fewer than 4 frames, or are not numbers.
    """
    signals = measure(joints)
    flights = flights_of(signals)
    running = running_of(flights, signals)
    turns = turns_of(signals)
    postures = postures_of(signals)
    changes = changes_of(postures)
    kicks = kicks_of(signals)
    events: list[Event] = [
        *jumps_of(signals, flights, running),
        *kicks,
        *knees_of(signals, kicks),
        *balances_of(signals),
        *climbs_of(signals),
        *raises_of(signals),
        *waves_of(signals),
        *punches_of(signals),
        *arm_circles_of(signals),
        *claps_of(signals),
        *changes,
        *dips_of(signals, changes),
    ]
    return Description(
        frames=signals.frames,
        path=path_of(signals, turns),
        moves=moves_of(signals, running, treading_of(signals)),
        turns=turns,
        postures=postures,
        events=tuple(sorted(events, key=lambda event: (event.start, event.kind, event.side))),
        steps=steps_of(signals),
        twist=twist_of(signals),
        activity=activity_of(signals),
    )
