"""BVH (Biovision hierarchy): a tree of joints with offsets, then one line of channels per frame.

A joint's rotation is the product of its rotation channels in the order they are listed
(`Zrotation Xrotation Yrotation` means R = Rz Rx Ry); position channels replace its offset.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from latentmotion.errors import FileFormatError
from latentmotion.formats.bvh_hierarchy import hierarchy_lines, read_hierarchy
from latentmotion.formats.checks import check_filled, checked_animation, checked_rate
from latentmotion.formats.lines import meters_per_unit, numbers, read_lines, table, whole_rate
from latentmotion.kinematics.animation import Animation
from latentmotion.kinematics.rotations import euler_from_matrix, matrix_from_euler
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.storage.files import atomic_file
from latentmotion.storage.reading import blamed_on

WRITTEN_ORDER = "ZXY"
"""Rotation order of the files we write: an upright body is far from its singularity."""

_SAME = 1e-7
"""Meters up to which a joint counts as staying at its offset."""

_FRAMES = re.compile(r"\s*frames\s*:?\s*(\d{1,12})\s*", re.IGNORECASE)
_FRAME_TIME = re.compile(r"\s*frame\s*time\s*:?\s*(\S+)\s*", re.IGNORECASE)


def read_bvh(path: str | Path, unit: str | float = "centimeters") -> Animation:
    """Reads a BVH file: any hierarchy, channel order and rotation order.

    Args:
        path: The file.
        unit: Its unit of length: `centimeters`, `meters`, `millimeters`, `inches`, `feet`, `cmu`
            (the MotionBuilder-friendly conversion of CMU), or meters per unit.

    Returns:
        The animation in meters. End sites are joints named `<parent>_end`.

    Raises:
        FileFormatError: The file is damaged or not BVH.
        InputError: The unit is unknown.
    """
    scale = meters_per_unit(unit)
    lines = read_lines(path)
    nodes, start = read_hierarchy(Path(path), lines)
    count, fps, body = _read_timing(Path(path), lines, start)
    columns = [(joint, *channel) for joint, node in enumerate(nodes) for channel in node.channels]
    values = table(path, lines, body, len(columns))
    if len(values) != count:
        problem = f"found {len(values)} frames, expected {count} as 'Frames:' says"
        raise FileFormatError(path, problem, len(lines))
    check_filled(path, count, len(nodes), values.size)
    offsets = scale * np.array([node.offset for node in nodes])
    translations = np.repeat(offsets[None], count, axis=0)
    rotation_columns: dict[int, list[int]] = {}
    for column, (joint, axis, kind) in enumerate(columns):
        if kind == "position":
            translations[:, joint, "XYZ".index(axis)] = scale * values[:, column]
        else:
            rotation_columns.setdefault(joint, []).append(column)
    rotations = np.tile(np.eye(3), (count, len(nodes), 1, 1))
    for order in {nodes[joint].order for joint in rotation_columns}:  # all its joints at once
        joints = [joint for joint in rotation_columns if nodes[joint].order == order]
        angles = np.deg2rad(values[:, [rotation_columns[joint] for joint in joints]])
        rotations[:, joints] = matrix_from_euler(angles, order)
    offsets[0] = 0
    with blamed_on(path):
        skeleton = Skeleton(
            name=Path(path).stem,
            names=tuple(node.name for node in nodes),
            parents=tuple(node.parent for node in nodes),
            offsets=offsets,
            end_sites=tuple(joint for joint, node in enumerate(nodes) if node.is_end),
        )
    moves = any(kind == "position" for node in nodes[1:] for _, kind in node.channels)
    root = translations[:, 0].copy()
    animation = Animation(skeleton, rotations, root, fps, translations if moves else None)
    return checked_animation(path, animation)


def write_bvh(path: str | Path, animation: Animation) -> None:
    """Writes an animation as BVH in centimeters, angles unwrapped so that curves never jump.

    Leaf joints get an end site, which BVH requires; joints with animated offsets get position
    channels.

    Args:
        path: The file, replaced only when all is written.
        animation: The animation.

    Raises:
        InputError: The folder does not exist or cannot be written.
    """
    skeleton, order = animation.skeleton, _depth_first(animation.skeleton)
    joints = [joint for joint in order if joint not in skeleton.end_sites]
    moving = {0}
    if animation.translations is not None:
        away = np.abs(animation.translations - skeleton.offsets).max((0, 2))
        moving |= {joint for joint in joints if away[joint] > _SAME}
    rotations = np.asarray(animation.rotations[:, joints], np.float64)
    angles = continuous_euler(rotations, WRITTEN_ORDER)
    columns = []
    for number, joint in enumerate(joints):
        if joint in moving:
            track = animation.translations
            positions = animation.root_positions if not joint or track is None else track[:, joint]
            columns.append(100 * np.asarray(positions, np.float64))
        columns.append(np.rad2deg(angles[:, number]))
    # Adding zero makes 0 of the -0 that rounding leaves.
    rows = np.round(np.concatenate(columns, axis=1), 6) + 0.0
    template = " ".join(["%.6f"] * rows.shape[1])
    with atomic_file(path) as temporary:
        lines = ["HIERARCHY", *hierarchy_lines(skeleton, moving, WRITTEN_ORDER), "MOTION"]
        lines += [f"Frames: {len(rows)}", f"Frame Time: {1 / animation.fps:.8f}"]
        lines += [template % tuple(row) for row in rows.tolist()]
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _read_timing(path: Path, lines: Sequence[str], start: int) -> tuple[int, float, int]:
    """Returns the number of frames, the frames per second and the index of the first frame."""
    filled = [(i, line) for i, line in enumerate(lines[start : start + 20], start) if line.strip()]
    if len(filled) < 2:
        raise FileFormatError(path, "ends after 'MOTION': the file is truncated", len(lines))
    (at, first), (then, second) = filled[:2]
    frames, time = _FRAMES.fullmatch(first), _FRAME_TIME.fullmatch(second)
    if frames is None or int(frames[1]) == 0:
        raise FileFormatError(path, f"found {first[:40]!r}, expected 'Frames: <count>'", at + 1)
    if time is None:
        raise FileFormatError(path, f"found {second[:40]!r}, expected 'Frame Time: <s>'", then + 1)
    seconds = float(numbers(path, then + 1, [time[1]], 1)[0])
    if seconds <= 0:
        raise FileFormatError(path, f"a frame time of {seconds} s; expected more", then + 1)
    fps = checked_rate(path, 1 / max(seconds, 1e-300), then + 1)
    return int(frames[1]), whole_rate(fps), then + 1


def _depth_first(skeleton: Skeleton, joint: int = 0) -> list[int]:
    return [joint, *(j for c in skeleton.children(joint) for j in _depth_first(skeleton, c))]


def continuous_euler(
    rotations: Float[np.ndarray, "frames joints 3 3"], order: str
) -> Float[np.ndarray, "frames joints 3"]:
    """Returns angles about the axes of `order` in radians, each frame the nearest to the last.

    Every rotation has two triples of angles, for ZXY (z, x, y) and (z + π, π - x, y + π). Changing
    both of two frames keeps their distance, so whether to change depends on two frames only, and
    which triple a frame takes is the parity of the changes so far.

    Args:
        rotations: Local rotations.
        order: A permutation of XYZ.
    """
    direct = euler_from_matrix(rotations, order)
    flipped = direct * np.array([1, -1, 1]) + np.pi
    change = _distance(direct[:-1], flipped[1:]) < _distance(direct[:-1], direct[1:])
    changed = np.cumsum(change, axis=0) % 2 == 1
    side = np.concatenate([np.zeros_like(changed, shape=(1, *changed.shape[1:])), changed])
    return np.unwrap(np.where(side[..., None], flipped, direct), axis=0)


def _distance(
    a: Float[np.ndarray, "*batch 3"], b: Float[np.ndarray, "*batch 3"]
) -> Float[np.ndarray, "*batch"]:
    return np.sum(np.abs((a - b + np.pi) % (2 * np.pi) - np.pi), axis=-1)
