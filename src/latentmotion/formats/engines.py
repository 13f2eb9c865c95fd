"""Figures for other programs: a game engine's names of bones, or the skeleton of a mocap data set.

Engines. The root bone carries root motion: the path along the floor and the heading, both without
the sway of the steps; the pelvis moves relative to it. In the first and the last frame the root has
the pelvis' place and the body's heading, so that clips played by their root motion follow each
other as `Motion.joined` puts them. Mixamo's figures have no such bone: all is on the hips. Axes and
unit are the format's; engines convert them on import.

Data sets. Readers of research code expect the names, the order of joints, the unit and the local
axes of LAFAN1 or CMU, and three channels a joint. The body keeps its own lengths.

Folders that Godot 4 and Unity import without a click: settings and a script beside the figure.

Godot reads `.import` files beside its assets, so loops are loops at once; the scene moves by the
root motion. Unity asks the scripts of a project how a model is imported, when they are compiled.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.arrays import unit
from latentmotion.cleanup.loops import is_loop, turns_beside, unrolled
from latentmotion.cleanup.pipeline import ground_path
from latentmotion.cleanup.smoothing import gaussian
from latentmotion.errors import InputError
from latentmotion.formats import EngineName
from latentmotion.formats.bvh import OURS, BvhLayout
from latentmotion.kinematics.rotations import matrix_from_axis_angle
from latentmotion.kinematics.skeleton import HUMANML3D, Animation, Skeleton
from latentmotion.kinematics.standing import rebased
from latentmotion.motion import Motion
from latentmotion.render.mannequin import Mannequin, make_mannequin
from latentmotion.representation.canonical import heading
from latentmotion.storage import configuration, files
from latentmotion.storage.reading import packaged_toml


@dataclass(frozen=True)
class Engine:
    """Conventions of a game engine for figures."""

    root: str = ""  # Name of the root bone; empty where the hips are the root.
    bones: tuple[str, ...] = ()  # Names of the bones, in the order of HumanML3D's joints.
    fps: float = 30.0  # Usual frames per second of animations.
    endings: tuple[str, ...] = (".glb", ".gltf", ".fbx", ".bvh")  # Files that hold such figures.
    # Joints of a data set in their order: name, parent, HumanML3D's joint. An empty joint rests at
    # its parent. Without any, the tree is our own below the root.
    tree: tuple[tuple[str, str, str], ...] = ()
    bvh: BvhLayout = OURS  # How BVH files of it are written.
    along_x: bool = False  # Whether bones lie along their own x, as LAFAN1's do.


# Standard deviation, seconds, of the Gaussian that takes the sway of steps out of root motion.
_SWAY = 0.25


@cache
def engines() -> Mapping[str, Engine]:
    """Returns the presets by name: engines, and data sets."""
    rows = packaged_toml(__file__, "engines.toml")
    return {name: configuration.from_json(Engine, row) for name, row in rows.items()}


def for_engine(motion: Motion, name: EngineName) -> Motion:
    """Returns a motion of the same body with an engine's bones and root motion on its root bone.

    Raises:
        InputError: The motion is of other joints than HumanML3D's.
    """
    engine, animation = engines()[name], motion.animation()
    old = animation.skeleton
    if old.names != HUMANML3D.names:
        raise InputError(
            f"bones of {name} are known for HumanML3D's 22 joints, not for {old.name!r}"
        )
    if engine.tree:
        return _figure(motion, _of_data_set(name, engine, animation))
    if not engine.root:
        renamed = replace(old, name=name, names=engine.bones)
        return _figure(motion, replace(animation, skeleton=renamed))
    height = -old.rest_joints()[:, 1].min()
    skeleton = Skeleton(
        name=name,
        names=(engine.root, *engine.bones),
        parents=(-1, *(parent + 1 for parent in old.parents)),
        offsets=np.concatenate([[(0, 0, 0), (0, height, 0)], old.offsets[1:]]),
        left_foot=tuple(joint + 1 for joint in old.left_foot),
        right_foot=tuple(joint + 1 for joint in old.right_foot),
    )
    path, yaw = root_motion(motion)
    facing = matrix_from_axis_angle(yaw[:, None] * np.array([0.0, 1.0, 0.0]))
    back = np.swapaxes(facing, -1, -2)
    translations = np.tile(skeleton.offsets, (len(motion), 1, 1))
    if animation.translations is not None:
        translations[:, 2:] = animation.translations[:, 1:]
    translations[:, 1] = np.einsum("fab,fb->fa", back, animation.root_positions - path)
    rotations = np.concatenate([facing[:, None], animation.rotations], axis=1)
    rotations[:, 1] = back @ rotations[:, 1]
    return _figure(motion, Animation(skeleton, rotations, path, motion.fps, translations))


def root_motion(
    motion: Motion,
) -> tuple[Float[np.ndarray, "frames 3"], Float[np.ndarray, " frames"]]:
    """Returns the path of a body along the floor and its heading, without the sway of the steps.

    Both begin and end with the pelvis' place and the body's heading; of a loop they are smooth
    beyond its ends.

    Args:
        motion: Any motion with hips and shoulders.
    """
    beside = turns_beside(motion) if is_loop(motion) else 0
    whole = unrolled(motion, beside, beside) if beside else motion
    joints = whole.joints.astype(np.float64)
    yaw = gaussian(np.unwrap(heading(joints, whole.skeleton)), _SWAY * motion.fps)
    path = ground_path(joints, motion.fps, _SWAY)
    if not beside:
        return path, yaw
    first = beside * (len(motion) - 1)
    inside = slice(first, first + len(motion))
    return path[inside], yaw[inside]


def _figure(motion: Motion, animation: Animation) -> Motion:
    """Returns the motion on another skeleton."""
    joints = animation.joints().astype(np.float32)
    figure = replace(motion, joints=joints, skeleton=animation.skeleton)
    # Its rotations are known, so writers need not solve for them again.
    figure.__dict__["_solved"] = animation
    return figure


def _of_data_set(name: str, engine: Engine, animation: Animation) -> Animation:
    """Returns an animation of HumanML3D's joints on the skeleton of a data set."""
    if engine.along_x:
        # LAFAN1's axes of our joints in a T-pose: bones lie along x and bend about z, which is left
        # in the trunk, right in the legs, and along the vertical in the arms.
        axes, old = np.zeros((len(animation.skeleton), 3, 3)), animation.skeleton
        for joint, name_of_joint in enumerate(old.names):
            side, _, part = name_of_joint.partition("_")
            sign = 1.0 if side == "left" else -1.0
            along, about = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
            if part in ("hip", "knee", "ankle", "foot"):
                along = np.array([0.0, 0.0, 1.0] if part == "foot" else [0.0, -1.0, 0.0])
                about = -about
            elif part:
                along, about = sign * about, sign * along
            below = old.children(joint)
            x = unit(old.offsets[below[0]] if len(below) == 1 else along)
            z = unit(about - x * (x @ about))
            axes[joint] = np.stack([x, np.cross(z, x), z], axis=-1)
        animation = rebased(animation, axes)
    ours, names = HUMANML3D.names.index, [joint for joint, _, _ in engine.tree]
    parents = [names.index(parent) if parent else -1 for _, parent, _ in engine.tree]
    offsets = np.zeros((len(names), 3))
    rotations = np.tile(np.eye(3), (len(animation), len(names), 1, 1))
    for row, (_, _, joint) in enumerate(engine.tree):
        if joint:
            offsets[row] = animation.skeleton.offsets[ours(joint)]
            rotations[:, row] = animation.rotations[:, ours(joint)]
    skeleton = Skeleton(name, tuple(names), tuple(parents), offsets)
    return Animation(skeleton, rotations, animation.root_positions, animation.fps)


def mannequin_of(skeleton: Skeleton) -> Mannequin:
    """Returns the mannequin of a skeleton, also of one with an engine's bones."""
    if skeleton.name not in engines() or len(skeleton) > len(HUMANML3D) + 1:
        return make_mannequin(skeleton)
    if len(skeleton) == len(HUMANML3D):
        body = make_mannequin(replace(HUMANML3D, offsets=skeleton.offsets))
        return replace(body, skeleton=skeleton)
    offsets = np.concatenate([np.zeros((1, 3)), skeleton.offsets[2:]])
    body = make_mannequin(replace(HUMANML3D, offsets=offsets))
    vertices = body.vertices + skeleton.offsets[1]
    return replace(body, vertices=vertices, joints=body.joints + 1, skeleton=skeleton)


Clip = Mapping[str, Any]  # An entry of a set's table: state, loop, seconds, events.

_TEMPLATES = Path(__file__).with_name("engine_templates")


def write_godot(figure: Path, clips: Sequence[Clip], root: str, fps: float) -> list[Path]:
    """Writes what Godot 4 needs beside a `.glb`: import settings, a scene, its script.

    Args:
        figure: The `.glb`.
        clips: Entries of the set's table.
        root: Name of the bone that carries the root motion; empty for none.
        fps: Frames per second of the clips.
    """
    loops = {clip["state"]: {"settings/loop_mode": 1} for clip in clips if clip["loop"]}
    events = {
        clip["state"]: [[round(event["time"], 4), event["event"]] for event in clip["events"]]
        for clip in clips
    }
    script = figure.with_suffix(".gd")
    return [
        _written(
            figure.with_name(figure.name + ".import"),
            "godot.import",
            FPS=f"{fps:g}",
            SETTINGS=json.dumps({"animations": loops}, indent=0),
        ),
        _written(
            script,
            "godot.gd",
            NAME=figure.stem,
            ROOT=json.dumps(root),
            EVENTS=json.dumps(events),
            FIRST=json.dumps(clips[0]["state"]),
        ),
        _written(
            figure.with_suffix(".tscn"),
            "godot.tscn",
            SCRIPT=json.dumps(script.name),
            FIGURE=json.dumps(figure.name),
            NAME=json.dumps(figure.stem),
        ),
    ]


def write_unity(figure: Path, clips: Sequence[Clip], root: str) -> list[Path]:
    """Writes what Unity needs beside an `.fbx`: a script of the editor that sets its import.

    Args:
        figure: The `.fbx`.
        clips: Entries of the set's table.
        root: Name of the bone that carries the root motion; empty for none.
    """
    rows = []
    for clip in clips:
        times = ", ".join(f"{event['time'] / clip['seconds']:.5f}f" for event in clip["events"])
        what = ", ".join(json.dumps(event["event"]) for event in clip["events"])
        name, loops = json.dumps(clip["state"][:40].strip()), str(clip["loop"]).lower()
        rows.append(
            f"        new Known {{ name = {name}, loops = {loops}, times = new float[] "
            f"{{ {times} }}, what = new string[] {{ {what} }} }},"
        )
    return [
        _written(
            figure.parent / "Editor" / f"{figure.stem}Import.cs",
            "unity.cs",
            NAME=figure.stem,
            CLASS=re.sub(r"\W", "_", f"Import_{figure.stem}"),
            CLIPS="\n".join(rows),
            FILE=json.dumps(figure.name),
            ROOT=json.dumps(root or "-"),
        )
    ]


def _written(path: Path, name: str, **values: str) -> Path:
    """Writes a template, of which the dollar words are replaced."""
    template = (_TEMPLATES / name).read_text(encoding="utf-8")
    text = re.sub(r"\$([A-Z]+)\b", lambda match: values[match[1]], template)
    path.parent.mkdir(parents=True, exist_ok=True)
    files.write_file(path, text)
    return path
