"""How a body stands in a file: unit of length, up axis and rest pose, found from the body itself.

Files of motion rarely say in which unit and axes they are, and say it wrongly. The body tells:

    unit    a person's legs are 0.5 to 1.3 m long, in one of the units that programs use
    up      heads are above feet in most frames
    sides   knees bend, and toes point, the way that left and right say is ahead
    rest    legs hang from the hips, away from the shoulders; where a file's offsets do not stand
            so, the frame in which the body stands straightest takes their place

What the file's format leaves open, and the body decides, is a guess, and told as one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import unit as direction
from latentmotion.errors import DataError, InputError, hint
from latentmotion.kinematics.bone_names import SIDES, JointMap
from latentmotion.kinematics.humanoid import Humanoid
from latentmotion.kinematics.inverse_kinematics import solve
from latentmotion.kinematics.skeleton import HUMANML3D, Animation, Joints, check_fps

# Units of length by name; `cmu` is Acclaim's unit, 5.644 cm, that conversions of CMU's keep.
METERS_PER_UNIT: Mapping[str, float] = {
    "meters": 1.0,
    "centimeters": 0.01,
    "millimeters": 0.001,
    "inches": 0.0254,
    "feet": 0.3048,
    "decimeters": 0.1,
    "cmu": 0.0254 / 0.45,
}

# Lengths of a person's thigh and shank, meters.
_LEG = (0.5, 1.3)

# Meters; of several units, that in which a leg comes nearest is taken.
_USUAL_LEG = 0.82

# Lengths of legs in CMU's unit, meters: its subjects are adults.
_CMU_LEG = (0.68, 1.0)

# Lengths of a figure's legs in the unit that its format has, meters: children and giants.
_OWN_LEG = (0.3, 1.5)

# Lengths of a figure's legs in a unit that a user gives, meters.
_STATED_LEG = (0.15, 4.0)

# Axis that points up in a file → the axes of an upright figure in the file's, in the columns.
AXES: Mapping[str, Float[np.ndarray, "3 3"]] = {
    "y": np.eye(3),
    "z": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "-y": np.diag([1.0, -1, -1]),
    "-z": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "x": np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
    "-x": np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]),
}

# Cosine between the line from feet to head and an axis, from which a body stands along it.
_UPRIGHT = 0.5

# Shares of the frames in which a body stands: along the usual axis, and along another.
_MOST, _NEARLY_ALL = 0.5, 0.8

# Share of a leg's length by which a knee must be off the line from hip to ankle to show a side.
_BENT = 0.08

# A rest pose that faces an axis to within this angle is taken to face it.
_SQUARE = np.radians(10)

Rotations = Float[np.ndarray, "bones 3 3"]


@dataclass(frozen=True)
class Stated:
    """What a user says about motion files, over what they say and what bodies show.

    Raises:
        InputError: A unit or an axis is unknown, or the rate is no rate.
    """

    # Unit of length: a name of `METERS_PER_UNIT`, or meters per unit.
    unit: str | float | None = None
    up: str | None = None  # Axis that points up: a name of `AXES`.
    fps: float | None = None  # Frames per second.
    # Joint maps for skeletons of unknown names; one is used where its joints are there.
    joint_maps: tuple[JointMap, ...] = ()

    def __post_init__(self) -> None:
        if self.unit is not None:
            meters_per_unit(self.unit)
        if self.up is not None and self.up not in AXES:
            raise InputError(f"up is {self.up!r}: expected {', '.join(AXES)}")
        if self.fps is not None:
            check_fps(self.fps)


NOTHING = Stated()  # Nothing is stated: all is as the files and the bodies say.


def meters_per_unit(unit: str | float) -> float:
    """Returns how many meters one unit is.

    Args:
        unit: A name from `METERS_PER_UNIT`, or the number itself, also as text.

    Raises:
        InputError: The name is unknown or the number is not positive.
    """
    scale = METERS_PER_UNIT.get(unit, math.nan) if isinstance(unit, str) else float(unit)
    if isinstance(unit, str) and unit not in METERS_PER_UNIT:
        try:
            scale = float(unit)
        except ValueError:
            near = hint(unit, METERS_PER_UNIT)
            raise InputError(
                f"unknown unit of length {unit!r}; {near}, or a number: meters per unit"
            ) from None
    if not (math.isfinite(scale) and scale > 0):
        raise InputError(
            f"the unit of length is {unit} m, expected a positive number of meters, such as 0.01"
        )
    return scale


@dataclass(frozen=True, eq=False)
class Standing:
    """How a body stands in a file."""

    meters: float  # Meters per unit of the file.
    up: str  # Axis of the file that points up.
    leg: float  # Length of thigh and shank, meters.
    # What the body alone showed, one phrase each, with the option that overrules it.
    guesses: tuple[str, ...]

    @property
    def axes(self) -> Float[np.ndarray, "3 3"]:
        """The axes of the upright figure in the file's, in the columns."""
        return AXES[self.up]


def find_standing(
    joints: Joints, stated: Stated = NOTHING, declared: float | None = None, any_size: bool = False
) -> Standing:
    """Finds unit and up axis of a moving body.

    Args:
        joints: HumanML3D's 22 joints, in the file's unit and axes.
        stated: Unit, axis and rate as the user states them.
        declared: Meters per unit that the file or its format says; None where neither does.
        any_size: Whether a body that fits no unit is taken for a person's instead of refused, as
            characters that motions are put on may be toys or giants.

    Raises:
        DataError: It cannot be found, or contradicts what was stated; the message says which
            option to give. Or left and right are mixed up.
    """
    joints = np.asarray(joints, np.float64)
    index = HUMANML3D.names.index
    left, right = (
        np.stack([joints[:, index(f"{side}_{name}")] for name in ("hip", "knee", "ankle", "foot")])
        for side in SIDES
    )
    bones = np.linalg.norm(np.diff(np.stack([left, right])[:, :3], axis=1), axis=-1)
    leg = float(np.median(bones, axis=-1).sum(axis=1).mean())
    meters, guesses = _unit(leg, stated, declared, any_size)
    feet = (left[2] + right[2]) / 2
    upward = direction(joints[:, index("head")] - feet)
    up, about_up = (stated.up, []) if stated.up is not None else up_axis(upward)
    guesses += about_up
    # Both knees and toes show whether the body faces backward.
    ahead = direction(np.cross(left[0] - right[0], joints[:, index("neck")] - joints[:, 0]))
    knees, toes = [], []
    for hip, knee, ankle, foot in (left, right):
        line = direction(ankle - hip)
        off = (knee - hip) - line * ((knee - hip) * line).sum(-1, keepdims=True)
        bent = np.linalg.norm(off, axis=-1) > _BENT * leg
        knees += ((off * ahead).sum(-1)[bent] / leg).tolist()
        toes += ((foot - ankle) * ahead).sum(-1).tolist()
    if knees and toes and np.median(knees) < -_BENT / 2 and np.median(toes) < 0:
        raise DataError(
            "knees bend and toes point backward: left and right are swapped in the names or the "
            "joint map (--map), or the file is mirrored (left-handed axes); export it again"
        )
    return Standing(meters, up, leg * meters, tuple(guesses))


def _unit(
    leg: float, stated: Stated, declared: float | None, any_size: bool
) -> tuple[float, list[str]]:
    if not leg > 0:
        raise DataError("both legs are of length 0; correct the joint map (--map)")
    if stated.unit is not None:
        meters = meters_per_unit(stated.unit)
        if not _STATED_LEG[0] <= leg * meters <= _STATED_LEG[1]:
            raise DataError(
                f"--unit {stated.unit} makes its legs {leg * meters:.3g} m long; expected "
                f"{_LEG[0]:g} to {_LEG[1]:g} m: correct the unit, or leave it out"
            )
        return meters, []
    if declared is not None and _OWN_LEG[0] <= leg * declared <= _OWN_LEG[1]:
        return declared, []
    if declared is None and _LEG[0] <= leg * METERS_PER_UNIT["centimeters"] <= _LEG[1]:
        return METERS_PER_UNIT["centimeters"], []
    limits = {name: _CMU_LEG if name == "cmu" else _LEG for name in METERS_PER_UNIT}
    fitting = [
        name
        for name, meters in METERS_PER_UNIT.items()
        if limits[name][0] <= leg * meters <= limits[name][1]
    ]
    if not fitting and any_size:
        return _USUAL_LEG / leg, [f"its legs are taken to be {_USUAL_LEG} m long (or --unit)"]
    if not fitting:
        raise DataError(
            f"its legs are {leg:.4g} units long, a person's in no usual unit of length; give the "
            "unit with --unit, a name or meters per unit"
        )
    name = min(fitting, key=lambda name: abs(math.log(leg * METERS_PER_UNIT[name] / _USUAL_LEG)))
    meters = METERS_PER_UNIT[name]
    called = "units of 5.644 cm (cmu)" if name == "cmu" else name
    return meters, [f"lengths are taken for {called}, by legs of {leg * meters:.2f} m (or --unit)"]


def up_axis(upward: Float[np.ndarray, "frames 3"]) -> tuple[str, list[str]]:
    """Returns the axis along which a body stands in most frames, and what of it is a guess.

    Args:
        upward: Unit vectors from feet to head.

    Raises:
        DataError: It stands along none.
    """
    shares = {name: float((upward @ axes[:, 1] > _UPRIGHT).mean()) for name, axes in AXES.items()}
    if shares["y"] >= _MOST:
        return "y", []
    best = max(shares, key=shares.__getitem__)
    if shares[best] >= _NEARLY_ALL:
        return best, [f"{best} is taken to point up, by the head above the feet (or --up)"]
    if shares["y"] >= max(shares.values()):
        return "y", []
    raise DataError(
        f"the figure lies in {1 - shares['y']:.0%} of the frames if y points up, and stands "
        "along no other axis; give the axis that points up with --up"
    )


def upright(animation: Animation, standing: Standing) -> Animation:
    """Returns an animation of a file in meters, y up."""
    return in_axes(animation, standing.axes, standing.meters)


def in_axes(animation: Animation, axes: Float[np.ndarray, "3 3"], scale: float) -> Animation:
    """Returns an animation in other axes and another unit.

    Args:
        animation: The animation.
        axes: The new axes in the old ones, in the columns.
        scale: New units per old unit.
    """
    translations = animation.translations
    return replace(
        animation,
        skeleton=replace(
            animation.skeleton, offsets=scale * np.asarray(animation.skeleton.offsets) @ axes
        ),
        rotations=axes.T @ animation.rotations @ axes,
        root_positions=scale * animation.root_positions @ axes,
        translations=None if translations is None else scale * translations @ axes,
    )


@dataclass(frozen=True, eq=False)
class RestPose:
    """The rest pose of a body in its own file."""

    axes: Float[np.ndarray, "3 3"]  # Its left, up and ahead in the file's axes, in the columns.
    leg: float  # Length of thigh and shank, in the file's unit.

    @classmethod
    def of(cls, body: Humanoid) -> RestPose:
        """Returns the rest pose of a body.

        Raises:
            DataError: It has no legs to stand on, or its toes point backward.
        """
        hips, knees, ankles, shoulders = _rest(body)
        bones = np.stack([knees - hips, ankles - knees])
        leg = float(np.linalg.norm(bones, axis=-1).sum(0).mean())
        if np.linalg.norm(bones, axis=-1).min() <= 1e-6 * max(leg, 1e-9):
            raise DataError("a leg of the rig has a bone of length 0; correct the map of joints")
        upward, left = shoulders.mean(0) - ankles.mean(0), hips[0] - hips[1]
        axis = int(np.argmax(np.abs(upward)))
        up = np.eye(3)[axis] * np.sign(upward[axis])
        across = left - up * (left @ up)
        if np.linalg.norm(across) < 1e-9:
            raise DataError("both hips of the rig are at the same place; correct the map of joints")
        across /= np.linalg.norm(across)
        axis = int(np.argmax(np.abs(across)))
        nearest = np.eye(3)[axis] * np.sign(across[axis])
        across = nearest if across @ nearest > np.cos(_SQUARE) else across
        axes = np.stack([across, up, np.cross(across, up)], axis=-1)
        rest = body.skeleton.rest_joints()
        toes = [
            rest[body.joints[f"{side}_foot"]] - ankle
            for side, ankle in zip(SIDES, ankles, strict=True)
            if f"{side}_foot" in body.joints
        ]
        if toes and (np.sum(toes, axis=0) @ axes[:, 2]) < -0.02 * leg:
            raise DataError("the rig's toes point backward: left and right are mixed up in the map")
        return cls(axes, leg)


def _rest(body: Humanoid) -> Float[np.ndarray, "parts sides 3"]:
    """Returns hips, knees, ankles and shoulders of the rest pose."""
    rest = body.skeleton.rest_joints()
    names = ("hip", "knee", "ankle", "shoulder")
    return np.array([[rest[body.joints[f"{side}_{name}"]] for side in SIDES] for name in names])


def rest_stands(body: Humanoid) -> bool:
    """Returns whether legs hang from the hips, and the shoulders are above them, at rest."""
    hips, _, ankles, shoulders = _rest(body)
    middle = hips.mean(0)
    down, up = ankles.mean(0) - middle, shoulders.mean(0) - middle
    lengths = np.linalg.norm(down), np.linalg.norm(up)
    apart = np.linalg.norm(hips[0] - hips[1])
    # Half a right angle: T-poses and A-poses stand, bones along one axis or in a heap do not.
    return bool(
        # Neither legs, trunk nor hips have a length of nearly zero.
        min(lengths) > 0.2 * max(lengths)
        and apart > 0.02 * max(lengths)
        and down @ up < -0.7 * lengths[0] * lengths[1]
    )


def up_at_rest(body: Humanoid) -> str:
    """Returns the axis along which the rest pose stands."""
    _, _, ankles, shoulders = _rest(body)
    upward = shoulders.mean(0) - ankles.mean(0)
    return max(AXES, key=lambda name: float(upward @ AXES[name][:, 1]))


def facing_at_rest(body: Humanoid) -> Float[np.ndarray, "3 3"]:
    """Returns the left, up and ahead of a rest pose, y up; none of its own if it lies."""
    return RestPose.of(body).axes if up_at_rest(body) == "y" else np.eye(3)


def straightest(joints: Joints) -> int:
    """Returns the frame in which a body, y up, stands straightest, of HumanML3D's joints."""
    index = HUMANML3D.names.index
    bones = [(0, "head")]
    for side in SIDES:
        bones += [(index(f"{side}_{low}"), f"{side}_{high}") for low, high in _STRAIGHT]
    heights = [direction(joints[:, index(high)] - joints[:, low])[:, 1] for low, high in bones]
    return int(np.argmax(np.minimum.reduce(heights)))


_STRAIGHT = (("ankle", "knee"), ("knee", "hip"))


def standing_bases(animation: Animation, body: Humanoid, joints: Joints) -> Rotations:
    """Returns rotations after which an animation's rest pose is our own T-pose.

    In the frame in which the body stands straightest, its joints are turned away from a T-pose as
    the inverse kinematics of their positions says; joints without a name turn with those that carry
    them.

    Args:
        animation: In meters, y up.
        body: Its joints by our names.
        joints: The positions of HumanML3D's 22.
    """
    frame = straightest(joints)
    ours = solve(joints[[frame, frame]], animation.fps)
    turned = ours.skeleton.world_rotations(ours.rotations[0])
    world = animation.skeleton.world_rotations(animation.rotations[frame])
    return np.swapaxes(world, -1, -2) @ turned[carriers(body)]


def carriers(body: Humanoid) -> list[int]:
    """Returns for each joint of a skeleton the one of HumanML3D's joints that it turns with."""
    named = {joint: HUMANML3D.names.index(name) for name, joint in body.joints.items()}
    named |= {body.chest: HUMANML3D.names.index("spine3"), body.pelvis: 0}
    carried: list[int] = []
    for joint, parent in enumerate(body.skeleton.parents):
        carried.append(named.get(joint, carried[parent] if parent >= 0 else 0))
    return carried


def rebased(animation: Animation, bases: Rotations, frame: int | None = None) -> Animation:
    """Returns the same movement as rotations away from another rest pose.

    Args:
        animation: The animation.
        bases: For each joint the rotation Q of W' = W Q, W its rotation in the world.
        frame: The frame whose offsets those at rest become, where they are animated.
    """
    skeleton = animation.skeleton
    above = bases[[max(parent, 0) for parent in skeleton.parents]]
    offsets, translations = np.asarray(skeleton.offsets), animation.translations
    if translations is not None:
        offsets = offsets if frame is None else translations[frame]
        translations = np.einsum("jba,tjb->tja", above, translations)
        offsets = offsets * (np.arange(len(skeleton)) > 0)[:, None]
    return replace(
        animation,
        skeleton=replace(skeleton, offsets=np.einsum("jba,jb->ja", above, offsets)),
        rotations=skeleton.local_rotations(skeleton.world_rotations(animation.rotations) @ bases),
        translations=translations,
    )
