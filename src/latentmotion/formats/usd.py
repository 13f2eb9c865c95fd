"""USD (`.usda` text, `.usdc` and `.usd` binary, `.usdz` package): a skinned mannequin by UsdSkel.

    /Figure             SkelRoot, the default prim
      /Skeleton         joints as paths (`pelvis/left_hip`), bind and rest pose; plays take 1
      /Mannequin        the mesh, bound to it
      /Material         its color
      /take_1, take_2   one SkelAnimation a take, caption and metadata in its custom data

Meters, y up, `timeCodesPerSecond` is the frame rate. Programs play the animation that the skeleton
names (`skel:animationSource`); to see another take, point it there.
Source: OpenUSD's UsdSkel schemas, https://openusd.org/release/api/usd_skel_page_front.html
"""

# pyright: reportAttributeAccessIssue=false
# (The names of usd-core's modules are made when they are imported.)

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.errors import InputError, MissingExtraError
from latentmotion.formats.bones import BoneAxes, bone_axes
from latentmotion.kinematics.animation import Animation
from latentmotion.kinematics.rotations import continuous_quaternions, quaternion_from_matrix
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.motion import Motion
from latentmotion.render.mannequin import Mannequin, make_mannequin
from latentmotion.storage.files import atomic_file

try:
    from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdShade, UsdSkel, UsdUtils, Vt
except ImportError as error:
    raise MissingExtraError("USD", "usd-core", "usd") from error

FIGURE = "/Figure"
NOTES = "latentmotion"
"""Key of the custom data."""

_COLOR = (0.10, 0.215, 0.552)
"""Linear RGB of the mannequin."""


def write(path: str | Path, motions: Sequence[Motion]) -> list[Path]:
    """Writes one figure; each motion is an animation of it, the first is the one that plays.

    Raises:
        InputError: The motions differ in skeleton, or the folder cannot be written.
    """
    if any(motion.skeleton.names != motions[0].skeleton.names for motion in motions):
        raise InputError("the takes of one USD file must share a skeleton; write several files")
    stage = make_stage(motions)
    with atomic_file(path) as temporary:
        if temporary.suffix.lower() == ".usdz":
            with tempfile.TemporaryDirectory() as folder:  # an archive without compression
                inside = Path(folder) / f"{Path(path).stem}.usdc"
                stage.GetRootLayer().Export(str(inside))
                asset = Sdf.AssetPath(str(inside))
                if not UsdUtils.CreateNewUsdzPackage(asset, str(temporary)):
                    raise InputError(f"cannot write {temporary}: USD refused to make a package")
        elif not stage.GetRootLayer().Export(str(temporary)):
            raise InputError(f"cannot write {path}: USD refused")
    return [Path(path)]


def make_stage(motions: Sequence[Motion]) -> Any:
    """Returns the figure with all motions as a stage in memory."""
    animations = [motion.animation() for motion in motions]
    skeleton = animations[0].skeleton
    stage = _new_stage(motions)
    root = UsdSkel.Root.Define(stage, FIGURE)
    stage.SetDefaultPrim(root.GetPrim())
    paths, axes = joint_paths(skeleton), bone_axes(skeleton)
    floor = np.array([0, -skeleton.rest_joints()[:, 1].min(), 0])
    bones = _add_skeleton(stage, axes, paths, floor)
    _add_mannequin(stage, make_mannequin(skeleton), floor)
    for number, (motion, animation) in enumerate(zip(motions, animations, strict=True), 1):
        prim = _add_take(stage, number, motion, animation, paths, axes)
        if number == 1:
            UsdSkel.BindingAPI.Apply(bones).CreateAnimationSourceRel().SetTargets([prim.GetPath()])
    # Where the figure ever is, so that viewers need not skin it to know.
    low, high = _corners(np.concatenate([a.joints().reshape(-1, 3) for a in animations]))
    corners = [Gf.Vec3f(*corner.tolist()) for corner in (low - 0.25, high + 0.25)]
    UsdGeom.Boundable(root).CreateExtentAttr(corners)
    return stage


def joint_paths(skeleton: Skeleton) -> list[str]:
    """Returns each joint's name behind those of all above it, as UsdSkel tells who is whose child.

    What is no letter, digit or underscore becomes an underscore, as USD demands.
    """
    paths: list[str] = []
    for name, parent in zip(skeleton.names, skeleton.parents, strict=True):
        own = Tf.MakeValidIdentifier(name)
        paths.append(own if parent < 0 else f"{paths[parent]}/{own}")
    return paths


def _new_stage(motions: Sequence[Motion]) -> Any:
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(motions[0].fps)
    stage.SetFramesPerSecond(motions[0].fps)
    stage.SetStartTimeCode(0)
    lengths = [(len(motion) - 1) / motion.fps for motion in motions]
    stage.SetEndTimeCode(max(lengths) * motions[0].fps)
    return stage


def _add_skeleton(
    stage: Any, axes: BoneAxes, paths: Sequence[str], floor: Float[np.ndarray, " 3"]
) -> Any:
    """Adds the bones in rest pose, standing on the floor; the y of each runs along it."""
    skeleton = axes.skeleton
    bones = UsdSkel.Skeleton.Define(stage, f"{FIGURE}/Skeleton")
    places = axes.offsets(np.array(skeleton.offsets, dtype=np.float64))
    places[0] = floor
    turns = axes.rotations(np.tile(np.eye(3), (len(skeleton), 1, 1)))
    bones.CreateJointsAttr(Vt.TokenArray(paths))
    bones.CreateJointNamesAttr(Vt.TokenArray(list(skeleton.names)))
    bones.CreateRestTransformsAttr(_moves(turns, places))
    bones.CreateBindTransformsAttr(_moves(axes.world, skeleton.rest_joints() + floor))
    return bones.GetPrim()


def _moves(turns: Float[np.ndarray, "joints 3 3"], places: Float[np.ndarray, "joints 3"]) -> Any:
    matrices = np.tile(np.eye(4), (len(places), 1, 1))
    # USD multiplies rows from the left.
    matrices[:, :3, :3], matrices[:, 3, :3] = np.swapaxes(turns, -1, -2), places
    return Vt.Matrix4dArray([Gf.Matrix4d(matrix) for matrix in matrices.tolist()])


def _add_mannequin(stage: Any, mannequin: Mannequin, floor: Float[np.ndarray, " 3"]) -> None:
    mesh = UsdGeom.Mesh.Define(stage, f"{FIGURE}/Mannequin")
    vertices = (mannequin.vertices + floor).astype("f4")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(vertices))
    mesh.CreateExtentAttr([Gf.Vec3f(*corner.tolist()) for corner in _corners(vertices)])
    mesh.CreateFaceVertexCountsAttr([4] * len(mannequin.quads))
    mesh.CreateFaceVertexIndicesAttr(mannequin.quads.reshape(-1).tolist())
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(mannequin.normals.astype("f4")))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDisplayColorAttr([Gf.Vec3f(*_COLOR)])
    skin = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    skin.CreateSkeletonRel().SetTargets([Sdf.Path(f"{FIGURE}/Skeleton")])
    skin.CreateJointIndicesPrimvar(False, 4).Set(mannequin.joints.reshape(-1).tolist())
    weights = mannequin.weights.astype("f4").reshape(-1)
    skin.CreateJointWeightsPrimvar(False, 4).Set(Vt.FloatArray.FromNumpy(weights))
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(_add_material(stage))


def _add_material(stage: Any) -> Any:
    material = UsdShade.Material.Define(stage, f"{FIGURE}/Material")
    surface = UsdShade.Shader.Define(stage, f"{FIGURE}/Material/Surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*_COLOR))
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.7)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    return material


def _add_take(
    stage: Any,
    number: int,
    motion: Motion,
    animation: Animation,
    paths: Sequence[str],
    axes: BoneAxes,
) -> Any:
    take = UsdSkel.Animation.Define(stage, f"{FIGURE}/take_{number}")
    take.CreateJointsAttr(Vt.TokenArray(paths))
    take.CreateScalesAttr(Vt.Vec3hArray([Gf.Vec3h(1)] * len(paths)))
    turns, moves = take.CreateRotationsAttr(), take.CreateTranslationsAttr()
    quaternions = continuous_quaternions(
        quaternion_from_matrix(axes.rotations(animation.rotations))
    )
    # UsdSkel's quaternions lie in memory as x, y, z, w.
    quaternions = quaternions[..., [1, 2, 3, 0]].astype("f4")
    places = animation.translations
    if places is None:
        places = np.tile(animation.skeleton.offsets, (len(animation), 1, 1))
    places = np.concatenate([animation.root_positions[:, None], places[:, 1:]], axis=1)
    places = axes.offsets(places).astype("f4")
    codes = np.arange(len(animation)) * (stage.GetTimeCodesPerSecond() / animation.fps)
    for code, turn, place in zip(codes.tolist(), quaternions, places, strict=True):
        turns.Set(Vt.QuatfArray.FromNumpy(np.ascontiguousarray(turn)), code)
        moves.Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(place)), code)
    notes = {"caption": motion.caption, "fps": motion.fps, **motion.metadata}
    take.GetPrim().SetCustomDataByKey(NOTES, json.dumps(notes, ensure_ascii=False))
    take.GetPrim().SetDisplayName(motion.caption or f"take {number}")
    return take.GetPrim()


def _corners(points: Float[np.ndarray, "points 3"]) -> tuple[np.ndarray, np.ndarray]:
    return points.min(0), points.max(0)
