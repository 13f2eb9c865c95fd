"""Clips of a state machine: loops and single moves of one body that fit each other.

    idle                 a loop on the spot; its first pose P is where all others meet
    walk, run, …         loops along a straight path, at the speed that is asked for; each begins
                         with the left foot farthest ahead and has two steps of each foot
    jump, turn left, …   from P to P, by the degrees that are asked for

A loop's last frame is its first, so that clips can be played one after the other or blended at any
time; loops that travel are in step when their times are shares of their lengths.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import unit
from latentmotion.cleanup.loops import turn_of, unrolled
from latentmotion.cleanup.pipeline import USUAL, clean
from latentmotion.control.direct import at_goals, sliding_in_contact
from latentmotion.control.generator import Generator
from latentmotion.control.goals import FASTEST, Goal, Pose
from latentmotion.control.stream import generate_loop
from latentmotion.errors import InputError, hint
from latentmotion.formats.tables import contact_events
from latentmotion.kinematics.skeleton import Joints, joints_of_bones
from latentmotion.motion import Motion
from latentmotion.representation.canonical import heading, turn
from latentmotion.storage.reading import packaged_toml

# Sentence of each state that needs none, and whether it is a loop.
KNOWN = packaged_toml(__file__, "states.toml")

# Steps of each foot in a loop that travels.
_CYCLES = 2

# Seconds of the loops among which those that travel are chosen.
_LENGTHS = (1.2, 1.4, 1.6, 1.8, 2.0, 2.2, 2.4)

# Seconds of a loop on the spot.
_IDLE = 3.0

# Meters per second from which on a loop travels.
_TRAVELS = 0.25

# Factor by which a loop is sped up or slowed down to its speed at most.
_FASTER = 1.25


@dataclass(frozen=True)
class State:
    """A clip of a state machine."""

    name: str  # Name of the clip.
    prompt: str  # What the person does.
    loops: bool = False  # Whether it is a loop.
    # Meters per second of a loop that travels; by default as it is generated.
    speed: float | None = None
    # By how much a single move turns, positive to the left; by default as it is generated.
    degrees: float | None = None


@runtime_checkable
class TakesGenerator(Generator, Protocol):
    """A generator that also keeps the best of several takes; `MotionPipeline` is one."""

    def __call__(
        self, prompt: str, seconds: float | None, seed: int, *, goals: Sequence[Goal] = ()
    ) -> Motion:
        """Returns a motion, cleaned up and at its goals."""
        ...


def parse_state(text: str) -> State:
    """Reads a state: `idle`, `walk@1.4`, `turn left 90`, `wave=a person waves`.

    `NAME=loop:SENTENCE` is a loop of one's own.

    Raises:
        InputError: It is none of these.
    """
    name, equals, sentence = (part.strip() for part in text.partition("="))
    name, at, speed = (part.strip() for part in name.partition("@"))
    words = name.split()
    try:
        pace = float(speed) if at else None
        degrees = float(words[-1]) if words[:1] == ["turn"] and len(words) == 3 else None
    except ValueError as error:
        raise InputError(
            f"state {text!r}: expected a number, as in walk@1.4 or turn left 90"
        ) from error
    loops = sentence.startswith("loop:")
    prompt = sentence.removeprefix("loop:").strip()
    key = name if degrees is None else " ".join(words[:2])
    if not equals and key not in KNOWN:
        raise InputError(
            f"state {text!r} is unknown: {hint(key, KNOWN)}; or say what the person does: "
            f"'{name}=a person …', '{name}=loop:a person …'"
        )
    if not equals:
        prompt, loops = KNOWN[key]
    if not name or not prompt:
        raise InputError(f"state {text!r}: expected a name and a sentence, NAME=SENTENCE")
    if pace is not None and not (loops and 0 < pace <= FASTEST):
        raise InputError(
            f"state {text!r}: expected a speed above 0 and up to {FASTEST:g} m/s, of a loop"
        )
    if degrees is not None:
        if not 0 < degrees <= 360:
            raise InputError(f"state {text!r}: expected up to 360 degrees")
        prompt = f"a person turns {degrees:g} degrees to the {words[1]}"
        degrees = degrees if words[1] == "left" else -degrees
    return State(name, prompt, loops, pace, degrees)


def generate_states(
    generator: TakesGenerator, states: Sequence[State], seed: int = 0, takes: int = 4
) -> list[Motion]:
    """Generates the clips of a state machine, cleaned up.

    Each motion's metadata have `state`, its name; `loop`; `speed`, m/s; `degrees` by which it
    turns; and `events`, contacts of the feet.

    Args:
        generator: The model.
        states: The states; the first loop that does not travel is where all single moves begin and
            end. Without one an idle loop is generated for that, and not returned.
        seed: Seed of the noise.
        takes: Loops of each length that are compared.

    Raises:
        InputError: Two states have one name, or none of the takes fits.
        ModelError: The model has no `pullback.onnx`.
    """
    names = [state.name for state in states]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two states are called {name!r}; rename one")
    resting = (_still_loop(generator, state, seed, takes) for state in states if state.loops)
    idle = next((loop for loop in resting if loop is not None), None)
    if idle is None:
        idle = _still_loop(generator, State("idle", *KNOWN["idle"]), seed, takes)
    assert idle is not None, "who stands still does not travel"
    start = Motion(idle.joints[:1], idle.fps, idle.skeleton)
    idle = _placed(_on_body(idle, start))
    start = replace(start, joints=idle.joints[:1])
    clips = []
    for state in states:
        if not state.loops:
            clip = _move(generator, state, start, seed)
        elif state.prompt == idle.caption:
            clip = idle
        else:
            still = _still_loop(generator, state, seed, takes)
            clip = _placed(_on_body(still, start)) if still else None
            clip = clip or _traveling_loop(generator, state, start, seed, takes)
        about = {"state": state.name, "speed": round(_speed(clip), 4)}
        about["degrees"] = round(float(np.degrees(_turned(clip))), 2)
        about["events"] = contact_events(clip)
        other = {key: it for key, it in clip.metadata.items() if key not in ("goals", "best_of")}
        clips.append(replace(clip, caption=state.prompt, metadata={**other, **about}))
    return clips


def _still_loop(generator: Generator, state: State, seed: int, takes: int) -> Motion | None:
    """Returns the loop of a state on the spot, not yet cleaned up; None where it travels."""
    if state.speed is not None:
        return None
    loops = [generate_loop(generator, state.prompt, _IDLE, seed + n) for n in range(takes)]
    stillest = min(loops, key=_speed)
    return _advancing(stillest, np.zeros(3)) if _speed(stillest) < _TRAVELS else None


def _traveling_loop(
    generator: Generator, state: State, body: Motion, seed: int, takes: int
) -> Motion:
    """Returns the loop of a state along a straight path, in step and at its speed."""
    every: list[Motion] = []
    for seconds, number in product(_LENGTHS, range(takes)):
        loop = generate_loop(generator, state.prompt, seconds, seed + number)
        # Turned so that it travels along an axis, the nearest one.
        step = turn_of(loop)[1]
        way = float(np.arctan2(step[0], step[2]))
        aside = way - np.round(way / (np.pi / 2)) * (np.pi / 2)
        loop = _with(loop, turn(loop.joints.astype(np.float64), np.array(-aside)))
        if _steps(loop)[0] == _CYCLES:
            every.append(loop)
    speed = state.speed or float(np.median([_speed(loop) for loop in every] or [1.0]))
    loops: list[tuple[float, Motion]] = []
    for loop in every:
        # In another time, and what is left by its step.
        factor, count = _speed(loop) / speed, len(loop) - 1
        if not 1 / _FASTER <= factor <= _FASTER:
            continue
        frames = 2 * max(round(count * factor / 2), 2)  # even numbers fall on 30 frames per second
        timed = loop.resampled(loop.fps * frames / count)
        step = turn_of(timed)[1]
        stride = step / np.linalg.norm(step) * speed * frames / loop.fps
        timed = _advancing(replace(timed, fps=loop.fps), stride)
        # It begins with the frame in which the left foot is ahead most.
        whole, first = unrolled(timed, 0, 1).joints, _steps(timed)[1]
        joints = np.concatenate([whole, whole[-1:]])[first : first + len(timed)]
        moved = _placed(_on_body(_with(timed, joints), body))
        # The bend at its ends beside the greatest one, 0 to 1, and how far its feet slide.
        bends = np.diff(unrolled(moved, 1, 1).joints, n=2, axis=0)
        bends = np.linalg.norm(bends, axis=-1).max(axis=-1)
        ends = bends[len(moved) - 3 : len(moved)].max() / max(bends.max(), 1e-9)
        loops.append((sliding_in_contact(moved) + float(ends), moved))
    if not loops:
        pace = "" if state.speed is None else f" at {state.speed:g} m/s"
        raise InputError(
            f"state {state.name!r}: none of {len(_LENGTHS) * takes} loops of {state.prompt!r} has "
            f"{_CYCLES} steps of each foot{pace}; choose another speed, seed or sentence"
        )
    return min(loops, key=lambda loop: loop[0])[1]


def _move(generator: TakesGenerator, state: State, start: Motion, seed: int) -> Motion:
    """Returns a single move from a pose to the same pose, where and as the move leaves it."""
    free = generator(state.prompt, None, seed)
    # An even number of steps from frame to frame, so that the last falls on 30 frames per second.
    seconds = (len(free) - 1 + len(free) % 2) / free.fps
    angle = _turned(free) if state.degrees is None else np.radians(state.degrees)
    if state.degrees is None and abs(angle) < np.pi / 4:
        angle = 0.0
    place = (free.joints[-1, 0] - free.joints[0, 0]) * (1.0, 0.0, 1.0)
    place = place if state.degrees is None else np.zeros(3)  # it turns on the spot
    pose = start.joints.astype(np.float64)
    end = turn(pose, np.array(angle)) + place
    goals = [Pose(0.0, start)]
    goals.append(Pose(seconds - 1 / free.fps, replace(start, joints=end.astype(np.float32))))
    try:
        posed = generator(state.prompt, seconds, seed, goals=goals)
    except InputError as error:
        raise InputError(f"state {state.name!r}, {state.prompt!r}: {error}") from error
    return at_goals(_on_body(posed, start), goals)


def _on_body(motion: Motion, body: Motion) -> Motion:
    """Returns a motion whose bones have the lengths of another body's, its feet on the floor."""
    parents = motion.skeleton.parents
    lengths = np.linalg.norm(body.joints[0, 1:] - body.joints[0, list(parents[1:])], axis=-1)
    joints = motion.joints.astype(np.float64)
    bones = lengths[:, None] * unit(joints[:, 1:] - joints[:, list(parents[1:])])
    joints = joints_of_bones(joints[:, 0], bones, motion.skeleton)
    return clean(_with(motion, joints), replace(USUAL, smooth=False))


def _speed(motion: Motion) -> float:
    """Returns meters per second along the floor."""
    step = (motion.joints[-1, 0] - motion.joints[0, 0])[::2]
    return float(np.linalg.norm(step)) * motion.fps / max(len(motion) - 1, 1)


def _turned(motion: Motion) -> float:
    """Returns by how much the body turns, radians."""
    facing = np.unwrap(heading(motion.joints.astype(np.float64), motion.skeleton))
    return float(facing[-1] - facing[0])


def _with(motion: Motion, joints: Joints) -> Motion:
    return replace(motion, joints=joints.astype(np.float32))


def _placed(motion: Motion) -> Motion:
    """Returns the motion with its first pelvis above the origin; on the spot it also faces +z."""
    joints = motion.joints.astype(np.float64)
    joints = joints - joints[0, 0] * (1, 0, 1)
    if _speed(motion) < _TRAVELS:
        joints = turn(joints, -heading(joints[0], motion.skeleton))
    return _with(motion, joints)


def _advancing(loop: Motion, step: Float[np.ndarray, " 3"]) -> Motion:
    """Returns a loop whose turn advances by another step; the difference is spread evenly."""
    more = step - turn_of(loop)[1]
    share = np.linspace(0, 1, len(loop))[:, None, None]
    return _with(loop, loop.joints + share * more)


def _steps(loop: Motion) -> tuple[int, int]:
    """Returns how often the left foot passes the right one in a turn, and when it is ahead most."""
    names, joints = loop.skeleton.names, loop.joints[:-1].astype(np.float64)
    step = turn_of(loop)[1]
    apart = joints[:, names.index("left_ankle")] - joints[:, names.index("right_ankle")]
    ahead = apart @ (step / max(float(np.linalg.norm(step)), 1e-9))
    waves = np.fft.rfft(ahead - ahead.mean())
    cycles = int(np.abs(waves).argmax())
    if cycles == 0:
        return 0, 0
    period = len(ahead) / cycles
    phase = round(-float(np.angle(waves[cycles])) / (2 * np.pi) * period) % round(period)
    return cycles, phase
