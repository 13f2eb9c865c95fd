"""Runs under a Python that has `pxr` (usd-core): asks UsdSkel itself where the joints are.

Usage: python in_usd.py FILE RESULT.json. Every SkelAnimation of the file is a take; it is asked for
by pointing the skeleton to it, in the session layer alone.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from pxr import Gf, Usd, UsdGeom, UsdSkel


def main(path: str, result: str) -> None:
    stage = Usd.Stage.Open(path)
    root = UsdSkel.Root(stage.GetDefaultPrim())
    bones = next(prim for prim in stage.Traverse() if prim.IsA(UsdSkel.Skeleton))
    takes = [prim for prim in stage.Traverse() if prim.IsA(UsdSkel.Animation)]
    played = UsdSkel.BindingAPI(bones).GetAnimationSource().GetPath()
    report = {
        "up": UsdGeom.GetStageUpAxis(stage),
        "meters": UsdGeom.GetStageMetersPerUnit(stage),
        "played": [prim.GetPath() for prim in takes].index(played),
        "names": list(UsdSkel.Skeleton(bones).GetJointNamesAttr().Get() or []),
        "takes": [play(stage, root, bones, prim) for prim in takes],
    }
    Path(result).write_text(json.dumps(report))


def play(stage: Usd.Stage, root: UsdSkel.Root, bones: Usd.Prim, take: Usd.Prim) -> dict:
    stage.SetEditTarget(stage.GetSessionLayer())
    UsdSkel.BindingAPI(bones).GetAnimationSourceRel().SetTargets([take.GetPath()])
    cache = UsdSkel.Cache()
    cache.Populate(root, Usd.PrimDefaultPredicate)
    query = cache.GetSkelQuery(UsdSkel.Skeleton(bones))
    codes = UsdSkel.Animation(take).GetRotationsAttr().GetTimeSamples()
    positions = []
    for code in codes:
        world = UsdGeom.XformCache(code).GetLocalToWorldTransform(bones)
        moves = query.ComputeJointSkelTransforms(code)
        positions.append([list((move * world).ExtractTranslation()) for move in moves])
    return {
        "seconds": (codes[-1] - codes[0]) / stage.GetTimeCodesPerSecond(),
        "bones": [path.split("/")[-1] for path in query.GetJointOrder()],
        "positions": positions,
        "soles": [lowest(stage, cache, root, code) for code in codes[::4]],
    }


def lowest(stage: Usd.Stage, cache: UsdSkel.Cache, root: UsdSkel.Root, code: float) -> float:
    """Height of the skin's lowest point, by UsdSkel's own skinning."""
    heights = []
    for binding in cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate):
        query = cache.GetSkelQuery(binding.GetSkeleton())
        moves = query.ComputeSkinningTransforms(code)
        for skin in binding.GetSkinningTargets():
            mesh = UsdGeom.Mesh(skin.GetPrim())
            points = mesh.GetPointsAttr().Get()
            assert skin.ComputeSkinnedPoints(moves, points, code)
            world = UsdGeom.XformCache(code).GetLocalToWorldTransform(skin.GetPrim())
            heights += [world.Transform(Gf.Vec3d(point))[1] for point in points]
    return min(heights)


if __name__ == "__main__":
    main(*sys.argv[1:])
