"""Runs under a Python that has `bpy`: opens files as a user does, says where their bones are.

Usage: python in_blender.py JOB.json. The job: `files`, each with `path`, `frames` of each take,
`fps`, and `pictures` as (take, frame, path); and `result`, the JSON to write. Positions are
Blender's world, meters, z up.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix, Vector

SIZE = (480, 360)


def import_glb(path: str, fps: float) -> None:
    bpy.ops.import_scene.gltf(filepath=path)


def import_bvh(path: str, fps: float) -> None:
    bpy.ops.import_anim.bvh(filepath=path, global_scale=0.01, update_scene_fps=True)


def import_usd(path: str, fps: float) -> None:
    bpy.ops.wm.usd_import(filepath=path)


def import_fbx(path: str, fps: float) -> None:
    bpy.ops.wm.fbx_import(filepath=path)


def import_fbx_by_the_old_importer(path: str, fps: float) -> None:
    bpy.ops.import_scene.fbx(filepath=path)


IMPORTERS = {".glb": import_glb, ".gltf": import_glb, ".bvh": import_bvh, ".fbx": import_fbx} | (
    dict.fromkeys((".usda", ".usdc", ".usdz", ".usd"), import_usd)
)


def run(job: dict) -> None:
    results = [open_file(file) for file in job["files"]]
    Path(job["result"]).write_text(json.dumps(results))


def open_file(file: dict) -> dict:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = round(file["fps"]) if file.get("set_fps", True) else 24
    ending = Path(file["path"]).suffix
    importer = import_fbx_by_the_old_importer if file.get("old") else IMPORTERS[ending]
    importer(file["path"], file["fps"])
    armature = next(thing for thing in bpy.data.objects if thing.type == "ARMATURE")
    skins = [thing for thing in bpy.data.objects if thing.type == "MESH" and is_skin(thing)]
    takes = {}
    actions = list(enumerate(actions_of(armature)))
    # The first again at the end: what other takes did must not remain.
    for number, action in [*actions, *actions[:1]]:
        armature.animation_data.action = action
        armature.animation_data.action_slot = action.slots[0]
        takes[number] = play(armature, skins, action, file["frames"][number], file["fps"])
        for take, frame, picture in file["pictures"]:
            if take == number:
                show(takes[number]["first"] + frame * rate(scene) / file["fps"])
                render(armature, skins, picture)
    return {"takes": [*takes.values()], "rest": rest(armature), "scene_fps": rate(scene)}


def actions_of(armature: bpy.types.Object) -> list:
    """The takes: all actions of the armature in order of their names, which begin with numbers."""
    actions = [a for a in bpy.data.actions if any(s.target_id_type == "OBJECT" for s in a.slots)]
    return sorted(actions, key=lambda action: action.name)


def is_skin(thing: bpy.types.Object) -> bool:
    return any(modifier.type == "ARMATURE" for modifier in thing.modifiers)


def rate(scene: bpy.types.Scene) -> float:
    return scene.render.fps / scene.render.fps_base


def show(frame: float) -> None:
    bpy.context.scene.frame_set(int(np.floor(frame)), subframe=frame - np.floor(frame))


def play(armature, skins, action, frames: int, fps: float) -> dict:
    first, last = action.frame_range
    step = rate(bpy.context.scene) / fps
    positions, soles = [], []
    for frame in range(frames):
        show(first + frame * step)
        world = armature.matrix_world
        positions.append([list(world @ bone.head) for bone in armature.pose.bones])
        if frame % 4 == 0:
            soles += [lowest(skin) for skin in skins]
    return {
        "name": action.name,
        "first": first,
        "seconds": (last - first) / rate(bpy.context.scene),
        "bones": [bone.name for bone in armature.pose.bones],
        "positions": positions,
        "soles": soles,
    }


def lowest(skin: bpy.types.Object) -> float:
    evaluated = skin.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return float((points_of(evaluated.data) @ np.array(skin.matrix_world.to_3x3()).T)[:, 2].min())


def points_of(mesh: bpy.types.Mesh) -> np.ndarray:
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    return points.reshape(-1, 3)


def rest(armature: bpy.types.Object) -> dict:
    """Heads and tails of all bones at rest, in the world, and whose child each is."""
    world = armature.matrix_world
    return {
        bone.name: {
            "head": list(world @ bone.head_local),
            "tail": list(world @ bone.tail_local),
            "parent": bone.parent.name if bone.parent else None,
        }
        for bone in armature.data.bones
    }


def render(armature: bpy.types.Object, skins: list, path: str) -> None:
    """Draws the figure on a floor of tiles, seen from the front and a little from its left."""
    scene = bpy.context.scene
    world = armature.matrix_world
    heads = np.array([list(world @ bone.head) for bone in armature.pose.bones])
    center = (heads.min(0) + heads.max(0)) / 2
    made = [*tiles(center), *([] if skins else sticks(armature))]
    eye = Vector((center[0] + 2.0, center[1] - 4.2, 1.9))
    look = Vector((center[0], center[1], 0.75)) - eye
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.angle = np.radians(38)
    camera.matrix_world = (
        Matrix.Translation(eye) @ look.to_track_quat("-Z", "Y").to_matrix().to_4x4()
    )
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.display.shading.light = "STUDIO"
    scene.display.shading.color_type = "OBJECT"
    scene.display.shading.show_shadows = True
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.filepath = path
    for skin in skins:
        skin.color = (0.25, 0.45, 0.8, 1)
    bpy.ops.render.render(write_still=True)
    for thing in (*made, camera):
        bpy.data.objects.remove(thing)


def tiles(center: np.ndarray) -> list:
    """A floor at height 0; its tiles are half a meter wide."""
    made = []
    middle = np.round(center[:2] / 0.5).astype(int)
    for i in range(-5, 6):
        for j in range(-5, 6):
            x, y = 0.5 * (middle[0] + i), 0.5 * (middle[1] + j)
            corners = [(x + u, y + v, 0) for u, v in ((0, 0), (0.5, 0), (0.5, 0.5), (0, 0.5))]
            tile = new_mesh("tile", corners, [(0, 1, 2, 3)])
            light = 0.72 if (middle.sum() + i + j) % 2 else 0.55
            tile.color = (light, light, light, 1)
            made.append(tile)
    return made


def sticks(armature: bpy.types.Object) -> list:
    """What has no skin is drawn as the octahedra of Blender's own bones."""
    made = []
    for bone in armature.pose.bones:
        start, end = armature.matrix_world @ bone.head, armature.matrix_world @ bone.tail
        turn = (end - start).to_track_quat("Y", "Z").to_matrix()
        length = (end - start).length
        ring = [turn @ Vector((u * 0.035, 0.15 * length, v * 0.035)) for u, v in RING]
        points = [start, *(start + point for point in ring), end]
        faces = [(0, 1 + (k + 1) % 4, 1 + k) for k in range(4)]
        faces += [(5, 1 + k, 1 + (k + 1) % 4) for k in range(4)]
        made.append(new_mesh("bone", [tuple(point) for point in points], faces))
        made[-1].color = (0.85, 0.5, 0.3, 1)
    return made


RING = ((1, 1), (-1, 1), (-1, -1), (1, -1))


def new_mesh(name: str, points: list, faces: list) -> bpy.types.Object:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], faces)
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    return thing


if __name__ == "__main__":
    run(json.loads(Path(sys.argv[1]).read_text()))
