"""USD (`.usda` text, `.usdc` and `.usd` binary, `.usdz` package): a skinned mannequin by UsdSkel.

    /Figure             SkelRoot, the default prim
      /Skeleton         joints as paths (`pelvis/left_hip`), bind and rest pose; plays take 1
      /Mannequin        the mesh, bound to it
      /Material         its color
      /take_1, take_2   one SkelAnimation per take, caption and metadata in its custom data

Meters, y up, `timeCodesPerSecond` is the frame rate. Programs play the animation that the skeleton
names (`skel:animationSource`); to see another take, point it there.
Source: OpenUSD's UsdSkel schemas, https://openusd.org/release/api/usd_skel_page_front.html
"""

# pyright: reportAttributeAccessIssue=false
# (usd-core's modules define their names when they are imported.)

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.errors import InputError, MissingExtraError
from latentmotion.formats.bones import bone_axes
from latentmotion.kinematics.rotations import continuous_quaternions, quaternion_from_matrix
from latentmotion.kinematics.skeleton import Skeleton
from latentmotion.motion import Motion
from latentmotion.progress import counted
from latentmotion.render.mannequin import ACCENT, GREY, Mannequin, make_mannequin
from latentmotion.storage.files import atomic_file

try:
    from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdShade, UsdSkel, UsdUtils, Vt
except ImportError as error:
    raise MissingExtraError("USD", "usd-core", "usd") from error

FIGURE = "/Figure"
NOTES = "latentmotion"  # Key of the custom data of a take.


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
    animations = [motion.animation() for motion in counted(motions, "finding rotations")]
    skeleton, fps = animations[0].skeleton, motions[0].fps
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(fps)
    stage.SetFramesPerSecond(fps)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(max((len(motion) - 1) / motion.fps for motion in motions) * fps)
    root = UsdSkel.Root.Define(stage, FIGURE)
    stage.SetDefaultPrim(root.GetPrim())
    # The bones in rest pose, standing on the floor; the y of each runs along it.
    paths, axes = joint_paths(skeleton), bone_axes(skeleton)
    floor = np.array([0, -skeleton.rest_joints()[:, 1].min(), 0])
    offsets = axes.offsets(np.array(skeleton.offsets, dtype=np.float64))
    offsets[0] = floor
    rotations = axes.rotations(np.tile(np.eye(3), (len(skeleton), 1, 1)))
    bones = UsdSkel.Skeleton.Define(stage, f"{FIGURE}/Skeleton")
    bones.CreateJointsAttr(Vt.TokenArray(paths))
    bones.CreateJointNamesAttr(Vt.TokenArray(list(skeleton.names)))
    bones.CreateRestTransformsAttr(_transforms(rotations, offsets))
    bones.CreateBindTransformsAttr(_transforms(axes.world, skeleton.rest_joints() + floor))
    _add_mannequin(stage, make_mannequin(skeleton), floor)
    for number, (motion, animation) in enumerate(zip(motions, animations, strict=True), 1):
        take = UsdSkel.Animation.Define(stage, f"{FIGURE}/take_{number}")
        take.CreateJointsAttr(Vt.TokenArray(paths))
        take.CreateScalesAttr(Vt.Vec3hArray([Gf.Vec3h(1)] * len(paths)))
        turns, moves = take.CreateRotationsAttr(), take.CreateTranslationsAttr()
        quaternions = continuous_quaternions(
            quaternion_from_matrix(axes.rotations(animation.rotations))
        )
        # UsdSkel's quaternions lie in memory as x, y, z, w.
        quaternions = quaternions[..., [1, 2, 3, 0]].astype("f4")
        steps = animation.translations
        if steps is None:
            steps = np.tile(animation.skeleton.offsets, (len(animation), 1, 1))
        steps = np.concatenate([animation.root_positions[:, None], steps[:, 1:]], axis=1)
        steps = axes.offsets(steps).astype("f4")
        codes = (np.arange(len(animation)) * (fps / animation.fps)).tolist()
        for code, rotation, step in zip(codes, quaternions, steps, strict=True):
            turns.Set(Vt.QuatfArray.FromNumpy(np.ascontiguousarray(rotation)), code)
            moves.Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(step)), code)
        notes = {"caption": motion.caption, "fps": motion.fps, **motion.metadata}
        prim = take.GetPrim()
        prim.SetCustomDataByKey(NOTES, json.dumps(notes, ensure_ascii=False))
        prim.SetDisplayName(motion.caption or f"take {number}")
        if number == 1:
            binding = UsdSkel.BindingAPI.Apply(bones.GetPrim())
            binding.CreateAnimationSourceRel().SetTargets([prim.GetPath()])
    # The extent over all takes, so that viewers need not skin the figure to know it.
    low, high = _corners(np.concatenate([a.joints().reshape(-1, 3) for a in animations]))
    corners = [Gf.Vec3f(*corner.tolist()) for corner in (low - 0.25, high + 0.25)]
    UsdGeom.Boundable(root).CreateExtentAttr(corners)
    return stage


def joint_paths(skeleton: Skeleton) -> list[str]:
    """Returns each joint's path from the root, by which UsdSkel knows the hierarchy.

    Characters other than letters, digits and underscores become underscores, as USD requires.
    """
    paths: list[str] = []
    for name, parent in zip(skeleton.names, skeleton.parents, strict=True):
        valid = Tf.MakeValidIdentifier(name)
        paths.append(valid if parent < 0 else f"{paths[parent]}/{valid}")
    return paths


def _transforms(
    rotations: Float[np.ndarray, "joints 3 3"], positions: Float[np.ndarray, "joints 3"]
) -> Any:
    matrices = np.tile(np.eye(4), (len(positions), 1, 1))
    # USD multiplies rows from the left.
    matrices[:, :3, :3], matrices[:, 3, :3] = np.swapaxes(rotations, -1, -2), positions
    return Vt.Matrix4dArray([Gf.Matrix4d(matrix) for matrix in matrices.tolist()])


def _add_mannequin(stage: Any, mannequin: Mannequin, floor: Float[np.ndarray, " 3"]) -> None:
    mesh = UsdGeom.Mesh.Define(stage, f"{FIGURE}/Mannequin")
    vertices = (mannequin.vertices + floor).astype("f4")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(vertices))
    mesh.CreateExtentAttr([Gf.Vec3f(*corner.tolist()) for corner in _corners(vertices)])
    mesh.CreateFaceVertexCountsAttr([3] * len(mannequin.triangles))
    mesh.CreateFaceVertexIndicesAttr(mannequin.triangles.reshape(-1).tolist())
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(mannequin.normals.astype("f4")))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDisplayColorAttr([Gf.Vec3f(*GREY)])
    skin = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    skin.CreateSkeletonRel().SetTargets([Sdf.Path(f"{FIGURE}/Skeleton")])
    skin.CreateJointIndicesPrimvar(False, 4).Set(mannequin.joints.reshape(-1).tolist())
    weights = mannequin.weights.astype("f4").reshape(-1)
    skin.CreateJointWeightsPrimvar(False, 4).Set(Vt.FloatArray.FromNumpy(weights))
    halves = np.split(np.arange(len(mannequin.triangles)), [mannequin.shell])
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
    for name, color, faces in zip(("Body", "Accent"), (GREY, ACCENT), halves, strict=True):
        material = UsdShade.Material.Define(stage, f"{FIGURE}/{name}")
        surface = UsdShade.Shader.Define(stage, f"{FIGURE}/{name}/Surface")
        surface.CreateIdAttr("UsdPreviewSurface")
        surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*color))
        surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.6)
        material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
        part = UsdGeom.Subset.CreateGeomSubset(
            mesh, name, UsdGeom.Tokens.face, Vt.IntArray(faces.tolist()), "materialBind"
        )
        UsdShade.MaterialBindingAPI.Apply(part.GetPrim()).Bind(material)


def _corners(points: Float[np.ndarray, "points 3"]) -> tuple[np.ndarray, np.ndarray]:
    return points.min(0), points.max(0)
