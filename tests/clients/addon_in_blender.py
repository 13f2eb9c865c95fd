"""Run by a Python that has bpy, not by pytest: the add-on installed, used and taken away again.

    python addon_in_blender.py ZIP COMMAND NPZ WORK_FOLDER [PICTURE.png]

NPZ holds what `COMMAND generate PROMPT --seed SEED --fps FPS` writes for the numbers below. Prints
one JSON object of what was measured.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from types import MethodType, SimpleNamespace

ZIP, COMMAND, NPZ, WORK = (Path(argument).absolute() for argument in sys.argv[1:5])
PICTURE = sys.argv[5] if len(sys.argv) > 5 else None
os.environ["BLENDER_USER_RESOURCES"] = str(WORK / "user")

import bpy  # noqa: E402
import numpy as np  # noqa: E402
from mathutils import Matrix, Vector  # noqa: E402

PROMPT, SEED, FPS, SECONDS = "a person walks in a circle", 3, 24, 3.0
MIXAMO = {
    "pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2", "neck": "Neck",
    "head": "Head", "collar": "Shoulder", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand",
    "hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "foot": "ToeBase",
}  # fmt: skip


def truth() -> tuple[np.ndarray, list[str], list[int]]:
    """Joints in Blender's axes."""
    with np.load(NPZ) as file:
        joints = file["joints"].astype(float)
        names, parents = [str(n) for n in file["names"]], [int(p) for p in file["parents"]]
    return np.stack([joints[..., 0], -joints[..., 2], joints[..., 1]], axis=-1), names, parents


def heads(armature, names: list[str], frames: int) -> np.ndarray:
    """Where the bones' heads are, frame by frame, as Blender itself evaluates them."""
    scene, found = bpy.context.scene, []
    for frame in range(scene.frame_start, scene.frame_start + frames):
        scene.frame_set(frame)
        posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
        bones = posed.pose.bones
        found.append([posed.matrix_world @ bones[name].head for name in names])
    return np.array(found)


def install() -> str:
    """Installs the zip as an extension; returns the add-on's module."""
    bpy.ops.extensions.package_install_files(
        filepath=str(ZIP), repo="user_default", enable_on_install=True
    )
    return "bl_ext.user_default.latentmotion_blender"


def install_as_legacy() -> bool:
    """Installs the same zip as an add-on of the older kind, and takes it away."""
    bpy.ops.preferences.addon_install(filepath=str(ZIP))
    bpy.ops.preferences.addon_enable(module="latentmotion_blender")
    there = hasattr(bpy.types.Scene, "latentmotion")
    bpy.ops.preferences.addon_disable(module="latentmotion_blender")
    return there and not hasattr(bpy.types.Scene, "latentmotion")


def select(*objects) -> None:
    for each in bpy.context.view_layer.objects:
        each.select_set(False)
    bpy.context.view_layer.objects.active = objects[0] if objects else None
    for each in objects:
        each.select_set(True)


def press() -> str:
    """Presses Generate; returns the error, if there is one."""
    try:
        bpy.ops.latentmotion.generate()
    except RuntimeError as error:
        return str(error)
    return ""


def press_in_window() -> dict[str, object]:
    """Goes through what happens in a window: Blender asks again and again, and is never kept."""
    generate = sys.modules["bl_ext.user_default.latentmotion_blender.generate"]
    events = [SimpleNamespace(type=name) for name in ("TIMER", "MOUSEMOVE")]
    context = SimpleNamespace(
        window_manager=SimpleNamespace(event_timer_remove=lambda timer: None),
        screen=SimpleNamespace(areas=[]),
        scene=bpy.context.scene,
    )
    operator = SimpleNamespace(report=lambda kind, text: None, _timer=None)
    for name in ("_finished", "_failed", "_over"):
        setattr(operator, name, MethodType(getattr(generate.GenerateMotions, name), operator))
    looks, result = [], {"PASS_THROUGH"}
    generate.GenerationTask.running = generate.GenerationTask(bpy.context)
    while result == {"PASS_THROUGH"}:
        start = time.perf_counter()
        result = generate.GenerateMotions.modal(operator, context, events[len(looks) % 2])
        looks.append(time.perf_counter() - start)
        time.sleep(0.02)
    generate.GenerationTask.running = task = generate.GenerationTask(bpy.context)
    generate.GenerateMotions.modal(operator, context, events[0])
    escaped = generate.GenerateMotions.modal(operator, context, SimpleNamespace(type="ESC"))
    return {
        "result": [*result],
        "looks": len(looks),
        "longest_look_s": max(looks[:-1]),
        "escaped": [*escaped],
        "left": generate.GenerationTask.running is not None or task.folder.exists(),
    }


def unknown_icons() -> list[str]:
    """Draws the panel and the preferences on nothing; returns icons that Blender does not have."""
    known = bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items.keys()
    panel = bpy.types.Panel.bl_rna_get_subclass_py("VIEW3D_PT_latentmotion")
    layout = Paper()
    panel.draw(SimpleNamespace(layout=layout), bpy.context)
    return [icon for icon in layout.icons if icon not in known]


class Paper:
    """Stands for a layout: properties must exist."""

    def __init__(self) -> None:
        self.icons: list[str] = []

    def column(self, align: bool) -> Paper:
        return self

    def prop(self, owner, name: str, **_: object) -> None:
        assert name in owner.bl_rna.properties, name

    def label(self, text: str, icon: str) -> None:
        self.icons.append(icon)

    def operator(self, name: str, icon: str) -> None:
        bpy.ops.latentmotion.generate.get_rna_type()
        self.icons.append(icon)


def make_rig(rest: np.ndarray, names: list[str], parents: list[int], to_name) -> object:
    """An armature in an A-pose as game engines like it: in centimeters, y up, of any roll.

    As an object it is tilted to stand in Blender, and turned on the floor.
    """
    data = bpy.data.armatures.new("rig")
    rig = bpy.data.objects.new("rig", data)
    bpy.context.collection.objects.link(rig)
    select(rig)
    rig.matrix_world = Matrix.Translation((1, 2, 0)) @ Matrix.Rotation(0.7, 4, "Z")
    rig.matrix_world @= Matrix.Rotation(np.pi / 2, 4, "X") @ Matrix.Scale(0.01, 4)
    places = 115 * rest
    lower_arms(places, names, parents)
    bpy.ops.object.mode_set(mode="EDIT")
    random = np.random.default_rng(0)
    for joint, (name, parent) in enumerate(zip(names, parents, strict=True)):
        bone = data.edit_bones.new(to_name(name))
        below = [j for j, above in enumerate(parents) if above == joint]
        bone.head = places[joint]
        way = places[below[0]] - places[joint] if below else places[joint] - places[parent]
        bone.tail = places[joint] + 0.8 * way
        bone.roll = random.uniform(-3, 3)
        if parent >= 0:
            bone.parent = data.edit_bones[to_name(names[parent])]
    bpy.ops.object.mode_set(mode="OBJECT")
    rig.pose.bones[to_name("left_elbow")].rotation_mode = "XYZ"
    rig.pose.bones[to_name("left_knee")].rotation_mode = "AXIS_ANGLE"
    return rig


def lower_arms(places: np.ndarray, names: list[str], parents: list[int]) -> None:
    """Turns the arms of a T down by 50 degrees, in y-up axes that look along z."""
    for side, sign in (("left", -1), ("right", 1)):
        shoulder = names.index(f"{side}_shoulder")
        turn = np.array(Matrix.Rotation(sign * np.radians(50), 3, "Z"))
        for part in ("elbow", "wrist"):
            joint = names.index(f"{side}_{part}")
            places[joint] = places[shoulder] + turn @ (places[joint] - places[shoulder])


def angles(found: np.ndarray, wanted: np.ndarray, names, parents) -> dict[str, float]:
    """Largest angle between a bone's direction and the truth, degrees, over limbs and spine."""
    result = {}
    for joint, parent in enumerate(parents):
        if parent < 0:
            continue
        one, two = (x[:, joint] - x[:, parent] for x in (found, wanted))
        cosine = (one * two).sum(-1) / np.linalg.norm(one, axis=-1) / np.linalg.norm(two, axis=-1)
        result[names[joint]] = float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).max())
    return result


def mixamo(name: str) -> str:
    side, _, part = name.rpartition("_")
    return f"mixamorig:{side.capitalize()}{MIXAMO[part]}"


def picture(armature, path: str) -> None:
    """Renders the mannequin with Workbench, in four moments beside each other."""
    scene, middle = bpy.context.scene, Vector((0.0, 0.0, 0.9))
    skin = next(each for each in armature.children if each.type == "MESH")
    for number, frame in enumerate((0, 23, 46, 70)):
        scene.frame_set(scene.frame_start + frame)
        posed = skin.evaluated_get(bpy.context.evaluated_depsgraph_get())
        still = bpy.data.objects.new("still", bpy.data.meshes.new_from_object(posed))
        bpy.context.collection.objects.link(still)
        pelvis = armature.matrix_world @ armature.pose.bones["pelvis"].head
        aside = Vector((1.1 * number - 1.65 - pelvis.x, -pelvis.y, 0))
        still.matrix_world = Matrix.Translation(aside) @ skin.matrix_world
    skin.hide_render = True
    eye = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    bpy.context.collection.objects.link(eye)
    eye.location = middle + Vector((1.2, -7.5, 1.3))
    eye.rotation_euler = (middle - eye.location).to_track_quat("-Z", "Y").to_euler()
    scene.camera = eye
    scene.world = bpy.data.worlds.new("world")
    scene.world.color = (0.86, 0.88, 0.92)
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.display.shading.show_cavity = True
    scene.display.shading.color_type = "MATERIAL"
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x, scene.render.resolution_y = 900, 420
    scene.render.filepath = str(Path(path).absolute())
    bpy.ops.render.render(write_still=True)
    skin.hide_render = False
    for each in [each for each in bpy.data.objects if each.name.startswith("still")]:
        bpy.data.objects.remove(each)


def main() -> None:
    report: dict[str, object] = {"blender": bpy.app.version_string}
    bpy.ops.wm.read_homefile(use_empty=True)
    report["legacy"] = install_as_legacy()
    module = install()
    preferences = bpy.context.preferences.addons[module].preferences
    scene, wanted = bpy.context.scene, truth()
    settings = scene.latentmotion
    scene.render.fps = FPS
    settings.prompt, settings.seed, settings.seconds = PROMPT, SEED, SECONDS
    preferences.command = str(WORK / "nowhere")
    report["missing"] = press()
    preferences.command = str(COMMAND)
    settings.model = "nonesuch"
    report["bad_model"] = press()
    settings.model, settings.takes = "starter", 2

    joints, names, parents = wanted
    report["said"] = press()
    report["actions"] = [action.name for action in bpy.data.actions]
    mannequin = bpy.data.objects["Latent Motion"]
    error = np.linalg.norm(heads(mannequin, names, len(joints)) - joints, axis=-1)
    report["mannequin_error_m"] = [float(error.mean()), float(error.max())]
    report["meshes"] = [o.name for o in mannequin.children if o.type == "MESH"]
    report["icons"] = unknown_icons()
    if PICTURE:
        picture(mannequin, PICTURE)

    settings.takes = 1
    turn = np.array(Matrix.Rotation(0.7, 3, "Z"))
    rest = np.array([mannequin.data.bones[name].head_local for name in names])
    rest_y_up = np.stack([rest[:, 0], rest[:, 2], -rest[:, 1]], axis=-1)
    for kind, to_name in (("same_names", str), ("mixamo", mixamo)):
        rig = make_rig(rest_y_up, names, parents, to_name)
        report[f"{kind}_said"] = press()
        if rig.animation_data is None:
            continue
        found = heads(rig, [to_name(name) for name in names], len(joints))
        report[f"{kind}_action"] = rig.animation_data.action.name
        report[f"{kind}_angles"] = angles(found, joints @ turn.T, names, parents)
        path = (found[:, 0] - found[:1, 0])[:, :2] @ turn[:2, :2]
        report[f"{kind}_path"] = float(np.ptp(path[:, 1]) / np.ptp(joints[:, 0, 1]))
        report[f"{kind}_floor_m"] = float(found[..., 2].min())
    select()
    report["window"] = press_in_window()
    bpy.ops.preferences.addon_disable(module=module)
    left = [hasattr(bpy.types.Scene, "latentmotion"), hasattr(bpy.types, "VIEW3D_PT_latentmotion")]
    report["left"] = any(left)
    print("REPORT " + json.dumps(report), flush=True)
    # bpy as a module may crash while Python ends, when all is done.
    os._exit(0)


main()
