"""USD in: the bones of any UsdSkel figure and each SkelAnimation that moves them.

Units, the axis that is up, and all that lies above the skeleton are taken into account; `bones.py`
makes plain bones of joints whose rests are turned or scaled.
"""

# pyright: reportAttributeAccessIssue=false
# (The names of usd-core's modules are made when they are imported.)

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.errors import FileFormatError, MissingExtraError
from latentmotion.formats.bones import WorldPose, even_rate, plain_animation, plain_skeleton
from latentmotion.formats.takes import motion_of
from latentmotion.kinematics.animation import Animation
from latentmotion.kinematics.rotations import matrix_from_quaternion, quaternion_from_matrix
from latentmotion.motion import Motion

try:
    from pxr import Tf, Usd, UsdGeom, UsdSkel
except ImportError as error:
    raise MissingExtraError("USD", "usd-core", "usd") from error

_NOTES = "latentmotion"
_Y_FROM_Z = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""Takes what lies in axes with z up to ours."""


def read_takes(path: str | Path) -> list[Motion]:
    """Reads all animations as motions, with the captions of those that we wrote.

    Raises:
        FileFormatError: The file is damaged, or has no skeleton.
        DataError: No joint map fits the skeleton.
    """
    figure = _Figure(Path(path))
    return [motion_of(figure.animation(take), _notes(take)) for take in figure.takes]


def read_animations(path: str | Path) -> list[Animation]:
    """Reads all animations that move the skeleton with the most joints; its rest if there is none.

    Raises:
        FileFormatError: The file is damaged, or has no skeleton.
    """
    figure = _Figure(Path(path))
    return [figure.animation(take) for take in figure.takes]


class _Figure:
    """The largest skeleton of a file and its animations."""

    def __init__(self, path: Path) -> None:
        self.path, self.stage = path, _opened(path)
        prims = [*self.stage.Traverse(Usd.TraverseInstanceProxies())]
        skeletons = [UsdSkel.Skeleton(prim) for prim in prims if prim.IsA(UsdSkel.Skeleton)]
        bones = max(
            skeletons, key=lambda found: len(found.GetJointsAttr().Get() or ()), default=None
        )
        self.joints = [] if bones is None else [str(j) for j in bones.GetJointsAttr().Get() or ()]
        if bones is None or not self.joints:
            raise FileFormatError(path, "has no skeleton; expected a figure of UsdSkel")
        self.topology = self._parents()
        axes = np.eye(4)  # from the file's units and axes to ours
        up = np.eye(3) if UsdGeom.GetStageUpAxis(self.stage) == "Y" else _Y_FROM_Z
        axes[:3, :3] = up * UsdGeom.GetStageMetersPerUnit(self.stage)
        above = UsdGeom.XformCache().GetLocalToWorldTransform(bones.GetPrim())
        self.above = axes @ _columns(above)
        self.places = self._rest(bones)
        self.rest = self._pose(*(part[None] for part in _parts(self.places)))
        self.rest = WorldPose(self.rest.positions[0], self.rest.turns[0])
        names = [joint.rpartition("/")[2] for joint in self.joints]
        self.skeleton = plain_skeleton(path.stem, names, self.topology, self.rest)
        takes = [UsdSkel.Animation(prim) for prim in prims if prim.IsA(UsdSkel.Animation)]
        self.takes = [take for take in takes if self._known(take)] or [None]

    def animation(self, take: Any | None) -> Animation:
        """Returns how one animation moves the skeleton."""
        tracks = []
        if take is not None:
            tracks = [take.GetRotationsAttr(), take.GetTranslationsAttr(), take.GetScalesAttr()]
        keys = sorted({code for track in tracks for code in track.GetTimeSamples()})
        codes = np.array(keys, dtype=np.float64)
        pace = self.stage.GetTimeCodesPerSecond()
        fps, seconds = even_rate(codes / pace)
        moved = self._pose(*self._sampled(take, seconds * pace))
        return plain_animation(self.skeleton, self.rest, moved, fps)

    def _sampled(
        self, take: Any | None, codes: Float[np.ndarray, " frames"]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns places, turns and scales of all joints relative to their parents."""
        whole = [np.repeat(part[None], len(codes), axis=0) for part in _parts(self.places)]
        if take is None:
            return whole[0], whole[1], whole[2]
        columns = [self.joints.index(joint) for joint in self._known(take)]
        rows = [n for n, j in enumerate(take.GetJointsAttr().Get()) if str(j) in self.joints]
        tracks = (take.GetTranslationsAttr(), take.GetRotationsAttr(), take.GetScalesAttr())
        for part, track in zip(whole, tracks, strict=True):
            for frame, code in enumerate(codes.tolist()):
                values = track.Get(code)
                if values is not None and len(values):
                    part[frame, columns] = _array(values)[rows]
        if not all(np.isfinite(part).all() for part in whole):
            raise FileFormatError(self.path, f"{take.GetPath()} holds NaN or infinite numbers")
        return whole[0], whole[1], whole[2]

    def _pose(self, places: np.ndarray, turns: np.ndarray, scales: np.ndarray) -> WorldPose:
        """Returns where joints are and how they are turned in the world."""
        base = self.above[:3, :3]
        world = {-1: (self.above[:3, 3], _rotation(base), base)}
        for joint, parent in enumerate(self.topology):
            start, turn, linear = world[parent]
            world[joint] = (
                start + np.einsum("...ab,...b->...a", linear, places[:, joint]),
                turn @ turns[:, joint],
                linear @ (turns[:, joint] * scales[:, joint, None, :]),
            )
        joints = [world[joint] for joint in range(len(self.joints))]
        return WorldPose(*(np.stack([joint[n] for joint in joints], axis=1) for n in (0, 1)))

    def _known(self, take: Any) -> list[str]:
        """Returns the joints of an animation that are joints of the skeleton."""
        names = [str(joint) for joint in take.GetJointsAttr().Get() or ()]
        return [name for name in names if name in self.joints]

    def _parents(self) -> tuple[int, ...]:
        topology = UsdSkel.Topology(self.joints)
        valid, why = topology.Validate()
        parents = tuple(topology.GetParent(joint) for joint in range(len(self.joints)))
        if not valid or parents.count(-1) != 1 or parents[0] != -1:
            raise FileFormatError(self.path, f"its joints make no tree: {why or 'several roots'}")
        return parents

    def _rest(self, bones: Any) -> Float[np.ndarray, "joints 4 4"]:
        """Returns the rest pose relative to the parents; from the bind pose where there is none."""
        rest = bones.GetRestTransformsAttr().Get()
        if rest is not None and len(rest) == len(self.joints):
            return np.stack([_columns(matrix) for matrix in rest])
        bind = bones.GetBindTransformsAttr().Get()
        if bind is None or len(bind) != len(self.joints):
            raise FileFormatError(self.path, "its skeleton has neither a rest nor a bind pose")
        world = np.stack([_columns(matrix) for matrix in bind])
        above = [np.eye(4) if p < 0 else world[p] for p in self.topology]
        return np.linalg.inv(np.stack(above)) @ world


def _opened(path: Path) -> Any:
    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        reason = lines[-1][:200] if lines else "no reason given"
        raise FileFormatError(path, f"damaged, or not USD ({reason})") from error
    if stage is None:
        raise FileFormatError(path, "damaged, or not USD")
    return stage


def _notes(take: Any | None) -> dict[str, Any]:
    text = None if take is None else take.GetPrim().GetCustomDataByKey(_NOTES)
    try:
        notes = json.loads(text) if isinstance(text, str) else {}
    except ValueError:
        return {}
    return notes if isinstance(notes, dict) else {}


def _columns(matrix: Any) -> Float[np.ndarray, "4 4"]:
    """Returns a matrix that acts on columns; USD's act on rows."""
    return np.array(matrix, dtype=np.float64).T


def _array(values: Any) -> np.ndarray:
    """Returns vectors as they are, quaternions as matrices."""
    array = np.array(values, dtype=np.float64)
    if array.shape[-1] != 4:
        return array
    length = np.linalg.norm(array, axis=-1, keepdims=True)
    return matrix_from_quaternion((array / np.where(length > 0, length, 1))[..., [3, 0, 1, 2]])


def _parts(
    matrices: Float[np.ndarray, "joints 4 4"],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns translations, rotations and scales."""
    scales = np.linalg.norm(matrices[:, :3, :3], axis=1)
    return matrices[:, :3, 3], np.stack([_rotation(m[:3, :3]) for m in matrices]), scales


def _rotation(matrix: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """Returns a matrix without its scale."""
    length = np.linalg.norm(matrix, axis=0)
    turn = matrix / np.where(length > 0, length, 1)
    return matrix_from_quaternion(quaternion_from_matrix(turn))
