"""Runs inside Blender, which has its own Python: a `.glb` in, an `.fbx` out, a take per animation.

blender --background --factory-startup --python blender_to_fbx.py -- IN.glb OUT.fbx FPS
python blender_to_fbx.py -- IN.glb OUT.fbx FPS                       (a Python that has bpy)
"""

import sys

import bpy  # pyright: ignore[reportMissingImports]


def main(source: str, target: str, fps: float) -> None:
    """Converts one file."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    # Keys are put on frames while they are read, so the rate must stand before.
    scene.render.fps = max(1, round(fps))
    scene.render.fps_base = scene.render.fps / fps
    bpy.ops.import_scene.gltf(filepath=source)
    keep_the_figure()
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
    )


def keep_the_figure() -> None:
    """Deletes the shape that Blender's importer draws bones with."""
    for thing in list(bpy.data.objects):
        if thing.type == "MESH" and thing.find_armature() is None:
            bpy.data.objects.remove(thing)


if __name__ == "__main__":
    given = sys.argv[sys.argv.index("--") + 1 :]
    main(given[0], given[1], float(given[2]))
    print("latentmotion: fbx written", flush=True)
