"""Runs inside Blender, which has its own Python: `.glb` to `.fbx` or back, a take per animation.

blender --background --factory-startup --python blender_fbx.py -- IN.glb OUT.fbx FPS
blender --background --factory-startup --python blender_fbx.py -- IN.fbx OUT.glb
python blender_fbx.py -- …                                           (a Python that has bpy)
"""

import sys
from pathlib import Path

import bpy  # pyright: ignore[reportMissingImports]


def write_fbx(source: str, target: str, fps: float) -> None:
    """Converts a `.glb`."""
    scene = bpy.context.scene
    # Keys are put on frames while they are read, so the rate must stand before.
    scene.render.fps = max(1, round(fps))
    scene.render.fps_base = scene.render.fps / fps
    bpy.ops.import_scene.gltf(filepath=source)
    # The shapes that Blender's importer draws bones with.
    poses = [thing.pose for thing in bpy.data.objects if thing.type == "ARMATURE"]
    for shape in {bone.custom_shape for pose in poses for bone in pose.bones} - {None}:
        bpy.data.objects.remove(shape)
    for action in bpy.data.actions:
        # Colons are namespaces in some programs; Blender's names end at 63, armature's included.
        action.name = action.name.replace(":", "")[:40].strip()
    last = max((action.frame_range[1] for action in bpy.data.actions), default=0)
    scene.frame_start, scene.frame_end = 0, round(last)
    bpy.ops.export_scene.fbx(
        filepath=target,
        object_types={"ARMATURE", "MESH"},
        # Meters stay meters: the file says that its unit is 100 cm, and no object is scaled.
        apply_scale_options="FBX_SCALE_ALL",
        add_leaf_bones=False,
        bake_anim_use_nla_strips=False,
        bake_anim_use_all_actions=True,
        bake_anim_simplify_factor=0.0,
        path_mode="COPY",
        embed_textures=True,
    )


def write_glb(source: str, target: str) -> None:
    """Converts an `.fbx`; its rate becomes the scene's while it is read."""
    with Path(source).open("rb") as file:
        binary = file.read(18) == b"Kaydara FBX Binary"
    importers = []
    if binary and "fbx" in dir(bpy.ops.import_scene):
        importers.append(bpy.ops.import_scene.fbx)
    if "fbx_import" in dir(bpy.ops.wm):  # of text too, and of lamps, at which the other fails
        importers.append(bpy.ops.wm.fbx_import)
    for number, read in enumerate(importers, 1):
        try:
            read(filepath=source)
            break
        except (RuntimeError, AttributeError, TypeError):
            if number == len(importers):
                raise
            bpy.ops.wm.read_factory_settings(use_empty=True)
    options = {
        "export_animation_mode": "ACTIONS",
        "export_force_sampling": True,
        # Bones at rest stay in the animations: a file without a mesh says by them what bones are.
        "export_optimize_animation_size": False,
        "export_optimize_animation_keep_anim_armature": True,
        "export_frame_range": False,
        "export_def_bones": False,
        "export_rest_position_armature": True,
        "export_extra_animations": False,
    }
    supported = bpy.ops.export_scene.gltf.get_rna_type().properties.keys()
    settings = {name: value for name, value in options.items() if name in supported}
    bpy.ops.export_scene.gltf(filepath=target, export_format="GLB", **settings)


if __name__ == "__main__":
    arguments = sys.argv[sys.argv.index("--") + 1 :]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if len(arguments) == 3:
        write_fbx(arguments[0], arguments[1], float(arguments[2]))
    else:
        write_glb(arguments[0], arguments[1])
    print("latentmotion: converted", flush=True)
