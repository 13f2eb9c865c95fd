"""What a USD file holds: the bones of any UsdSkel figure and each SkelAnimation that moves them.

Positions include the file's unit, its up axis and all prims above the skeleton; `bones.py` turns
them into bones whose rest pose has neither rotation nor scale.
"""

# pyright: reportAttributeAccessIssue=false
# (usd-core's modules define their names when they are imported.)

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.errors import FileFormatError, LatentMotionError, MissingExtraError
from latentmotion.formats import bones as bone_poses
from latentmotion.formats import checks, usd_reader
from latentmotion.kinematics.rotations import matrix_from_quaternion, quaternion_from_matrix
from latentmotion.kinematics.skeleton import Animation
from latentmotion.storage import children, limits, reading

try:
    from pxr import Tf, Usd, UsdGeom, UsdSkel
except ImportError as error:
    raise MissingExtraError("USD", "usd-core", "usd") from error

_NOTES = "latentmotion"
# From axes with z up to ours.
_Y_FROM_Z = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


def main() -> None:
    """Reads the file named first and writes its animations to the file named second.

    `usd_reader` runs this as a program of its own, with limits: USD's library trusts what it reads.
    """
    source, target = Path(sys.argv[1]), Path(sys.argv[2])
    children.limit("AS", limits.USD_MEMORY + 4 * source.stat().st_size)
    children.limit("CPU", limits.USD_SECONDS)
    children.limit("CORE", 0)
    try:
        # Results are checked to be finite.
        with np.errstate(all="ignore"), reading.blamed_on(source):
            figure, frames = _Figure(source), 0
            skeleton = figure.skeleton
            arrays: dict[str, Any] = {
                "names": np.array(skeleton.names, dtype=np.str_),
                "parents": np.array(skeleton.parents),
                "offsets": skeleton.offsets,
                "takes": np.array(len(figure.takes)),
            }
            for number, take in enumerate(figure.takes):
                animation = checks.checked_animation(source, figure.animation(take, frames))
                frames += len(animation)
                text = None if take is None else take.GetPrim().GetCustomDataByKey(_NOTES)
                arrays |= {
                    f"rotations_{number}": animation.rotations,
                    f"root_{number}": animation.root_positions,
                    f"fps_{number}": np.array(animation.fps),
                    f"notes_{number}": np.array(text if isinstance(text, str) else "{}"),
                }
                if animation.translations is not None:
                    arrays[f"translations_{number}"] = animation.translations
    except LatentMotionError as error:
        print(str(error).removeprefix(f"{source}: "))
        sys.exit(usd_reader.REFUSED)
    except MemoryError:
        print(f"needs more than {limits.USD_MEMORY >> 30} GB of memory; cut it")
        sys.exit(usd_reader.REFUSED)
    try:
        with target.open("wb") as file:
            np.savez(file, **arrays)
    except OSError as error:
        print(error.strerror or error)
        sys.exit(usd_reader.UNWRITTEN)


class _Figure:
    """The largest skeleton of a file and its animations."""

    def __init__(self, path: Path) -> None:
        try:
            stage = Usd.Stage.Open(str(path))
        except Tf.ErrorException as error:
            lines = [line.strip() for line in str(error).splitlines() if line.strip()]
            reason = lines[-1][:200] if lines else "no reason given"
            raise FileFormatError(path, f"damaged, or not USD ({reason})") from error
        if stage is None:
            raise FileFormatError(path, "damaged, or not USD")
        folder = path.parent.resolve()
        for layer in stage.GetUsedLayers():
            inside = layer.realPath.partition("[")[0]
            if inside and not Path(inside).resolve().is_relative_to(folder):
                raise FileFormatError(path, f"names {inside}; expected files in its own folder")
        self.path, self.stage = path, stage
        prims = [*self.stage.Traverse(Usd.TraverseInstanceProxies())]
        skeletons = [UsdSkel.Skeleton(prim) for prim in prims if prim.IsA(UsdSkel.Skeleton)]
        bones = max(skeletons, key=lambda each: len(each.GetJointsAttr().Get() or ()), default=None)
        self.joints = [] if bones is None else [str(j) for j in bones.GetJointsAttr().Get() or ()]
        if bones is None or not self.joints:
            raise FileFormatError(path, "has no skeleton; expected a figure of UsdSkel")
        if len(self.joints) > limits.MOST_JOINTS:
            raise FileFormatError(path, f"has more than {limits.MOST_JOINTS:,} joints")
        topology = UsdSkel.Topology(self.joints)
        valid, why = topology.Validate()
        self.parents = tuple(topology.GetParent(joint) for joint in range(len(self.joints)))
        if not valid or self.parents.count(-1) != 1 or self.parents[0] != -1:
            raise FileFormatError(path, f"its joints make no tree: {why or 'several roots'}")
        axes = np.eye(4)  # from the file's units and axes to ours
        up = np.eye(3) if UsdGeom.GetStageUpAxis(self.stage) == "Y" else _Y_FROM_Z
        axes[:3, :3] = up * UsdGeom.GetStageMetersPerUnit(self.stage)
        above = UsdGeom.XformCache().GetLocalToWorldTransform(bones.GetPrim())
        self.above = axes @ _columns(above)
        # The rest pose relative to the parents; from the bind pose where there is none.
        stored = bones.GetRestTransformsAttr().Get()
        if stored is not None and len(stored) == len(self.joints):
            self.local = np.stack([_columns(matrix) for matrix in stored])
        else:
            bind = bones.GetBindTransformsAttr().Get()
            if bind is None or len(bind) != len(self.joints):
                raise FileFormatError(path, "its skeleton has neither a rest nor a bind pose")
            world = np.stack([_columns(matrix) for matrix in bind])
            parents = np.stack([np.eye(4) if p < 0 else world[p] for p in self.parents])
            self.local = np.linalg.inv(parents) @ world
        rest = self._pose(*(values[None] for values in _decomposed(self.local)))
        self.rest = bone_poses.WorldPose(rest.positions[0], rest.rotations[0])
        names = [joint.rpartition("/")[2] for joint in self.joints]
        self.skeleton = bone_poses.plain_skeleton(path.stem, names, self.parents, self.rest)
        takes = [UsdSkel.Animation(prim) for prim in prims if prim.IsA(UsdSkel.Animation)]
        self.takes = [take for take in takes if self._known_joints(take)] or [None]

    def animation(self, take: Any | None, frames_before: int) -> Animation:
        """Returns how one animation moves the skeleton, after so many frames of others."""
        tracks: list[Any] = []
        if take is not None:
            tracks = [take.GetTranslationsAttr(), take.GetRotationsAttr(), take.GetScalesAttr()]
        codes = sorted({code for track in tracks for code in track.GetTimeSamples()})
        rate = self.stage.GetTimeCodesPerSecond()
        if not 1e-6 < rate < 1e6:
            raise FileFormatError(self.path, f"{rate:g} time codes per second")
        times = np.array(codes, dtype=np.float64) / rate
        # A single frame has no rate of its own.
        fps, seconds = bone_poses.even_rate(self.path, times, *([rate] if len(codes) == 1 else []))
        size = self.path.stat().st_size // 4
        checks.check_filled(self.path, frames_before + len(seconds), len(self.joints), size)
        # Translations, rotations and scales of all joints relative to their parents.
        local = [np.repeat(rest[None], len(seconds), axis=0) for rest in _decomposed(self.local)]
        if take is not None:
            columns = [self.joints.index(joint) for joint in self._known_joints(take)]
            rows = [n for n, j in enumerate(take.GetJointsAttr().Get()) if str(j) in self.joints]
            for values, track in zip(local, tracks, strict=True):
                for frame, code in enumerate((seconds * rate).tolist()):
                    keys = np.array(track.Get(code) or (), dtype=np.float64)
                    if keys.shape[-1] == 4:  # quaternions
                        length = np.linalg.norm(keys, axis=-1, keepdims=True)
                        keys = (keys / np.where(length > 0, length, 1))[..., [3, 0, 1, 2]]
                        keys = matrix_from_quaternion(keys)
                    if len(keys):
                        values[frame, columns] = keys[rows]
            if not all(np.isfinite(values).all() for values in local):
                problem = f"{take.GetPath()} holds NaN or infinite numbers"
                raise FileFormatError(self.path, problem)
        return bone_poses.plain_animation(self.skeleton, self.rest, self._pose(*local), fps)

    def _pose(
        self, translations: np.ndarray, rotations: np.ndarray, scales: np.ndarray
    ) -> bone_poses.WorldPose:
        """Returns positions and rotations in the world."""
        base = self.above[:3, :3]
        world = {-1: (self.above[:3, 3], _rotation(base), base)}
        for joint, parent in enumerate(self.parents):
            local = translations[:, joint], rotations[:, joint], scales[:, joint]
            world[joint] = bone_poses.placed(world[parent], *local)
        joints = [world[joint] for joint in range(len(self.joints))]
        return bone_poses.WorldPose(
            *(np.stack([joint[n] for joint in joints], axis=1) for n in (0, 1))
        )

    def _known_joints(self, take: Any) -> list[str]:
        """Returns the joints of an animation that are joints of the skeleton."""
        names = [str(joint) for joint in take.GetJointsAttr().Get() or ()]
        return [name for name in names if name in self.joints]


def _columns(matrix: Any) -> Float[np.ndarray, "4 4"]:
    """Returns a matrix that acts on columns; USD's act on rows."""
    return np.array(matrix, dtype=np.float64).T


def _decomposed(
    matrices: Float[np.ndarray, "joints 4 4"],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns translations, rotations and scales."""
    scales = np.linalg.norm(matrices[:, :3, :3], axis=1)
    return matrices[:, :3, 3], np.stack([_rotation(m[:3, :3]) for m in matrices]), scales


def _rotation(matrix: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """Returns a matrix without its scale."""
    length = np.linalg.norm(matrix, axis=0)
    return matrix_from_quaternion(quaternion_from_matrix(matrix / np.where(length > 0, length, 1)))


if __name__ == "__main__":
    main()
