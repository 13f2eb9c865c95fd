"""Generate: runs the command in the background and makes Actions of the motions; the sidebar.

A selected armature whose bones have the motion's joint names gets the motion by name, any other
through `latentmotion retarget`. With no armature selected, our mannequin is imported.
"""

import math
import shutil
import tempfile
import textwrap
from collections.abc import Iterator
from pathlib import Path

import bpy
from mathutils import Vector

from . import directing
from .actions import make_action
from .bones import ArmatureBody
from .bvh import read_take
from .command import CommandJob
from .settings import MISSING, command_of

_SECONDS_BETWEEN_LOOKS = 0.1
# Letters of an error in one line of the panel.
_LINE = 44


class GenerationTask:
    """One press of the button: the settings, and the job that makes the motions.

    Raises:
        ValueError: The command was not found, or goals or markers cannot be used.
    """

    running: "GenerationTask | None" = None
    error = ""  # The last error, if any.

    def __init__(self, context: bpy.types.Context) -> None:
        self.command = command_of(context)
        if self.command is None:
            raise ValueError(MISSING)
        scene = context.scene
        self.settings = {name: getattr(scene.latentmotion, name) for name in _SETTINGS}
        self.fps = scene.render.fps / scene.render.fps_base
        target = target_of(context)
        self.target = target.name if target else None
        self.bones: dict[str, str] | None = None
        """The bone of each joint of a retargeted motion; by name if None."""
        directed = self._directed(context, target)
        self.folder = Path(tempfile.mkdtemp(prefix="latentmotion-"))
        self.scene = self.folder / "scene.json" if directed else None
        if directed and self.scene:
            directing.write_scene(directed, self.scene)
        self.job = CommandJob(self._calls(), self.folder)

    def _directed(self, context: bpy.types.Context, target: bpy.types.Object | None) -> dict | None:
        """Returns the scene file of goals or markers, or None where the sentence is all."""
        scene, settings = context.scene, self.settings
        if settings["directed_by"] == "SENTENCE":
            return None
        origin = target.matrix_world.translation if target else scene.cursor.location
        turn = target.matrix_world.to_quaternion() if target else None
        heading = 2 * math.atan2(turn.z, turn.w) if turn else 0.0
        place = directing.Place(tuple(origin), heading, scene.frame_start, self.fps)
        if settings["directed_by"] == "MARKERS":
            markers = [(marker.name, marker.frame) for marker in scene.timeline_markers]
            return directing.marker_scene(settings["prompt"], markers, place, scene.frame_end)
        goals, paths, now = [], [], (scene.frame_current, scene.frame_subframe)
        for item in scene.objects:
            joint = directing.joint_of(item)
            animation = item.animation_data
            action = animation.action if animation else None
            if action is None or hasattr(action, "fcurves"):  # before Blender 5
                bags = [action] if action else []
            else:
                strips = (strip for layer in action.layers for strip in layer.strips)
                bags = [strip.channelbag(animation.action_slot) for strip in strips]
            curves = [curve for bag in bags if bag for curve in bag.fcurves]
            for frame in directing.frames_of(item, curves) if joint else []:
                scene.frame_set(int(frame // 1), subframe=frame % 1)
                goals.append(directing.Goal(joint, frame, tuple(item.matrix_world.translation)))
            if item.type == "CURVE" and item.name.partition(".")[0] == "path":
                paths.append(item)
        scene.frame_set(now[0], subframe=now[1])
        if len(paths) > 1:
            raise ValueError(f"{len(paths)} curves named path: a motion follows one")
        points = [
            item.matrix_world @ Vector(p)
            for item in paths
            for p in directing.path_points(item.data.splines)
        ]
        return directing.goal_scene(settings["prompt"], settings["seconds"], goals, points, place)

    def _calls(self) -> Iterator[list[str]]:
        """Yields the calls of the command; the later ones depend on the files of the first."""
        settings, prompts = self.settings, self.folder / "prompt.txt"
        prompts.write_text(settings["prompt"] + "\n", encoding="utf-8")
        call = [self.command, "generate", "--json", "--model", settings["model"]]
        if self.scene:
            call += ["--scene", str(self.scene)]
        else:
            call += ["--file", str(prompts)] if settings["prompt"].strip() else []
            call += ["--seconds", f"{settings['seconds']:.6g}"]
        call += ["--fps", f"{self.fps:.9g}", "--count", str(settings["takes"])]
        call += ["--seed", str(settings["seed"])]
        yield [*call, "-o", str(self.folder / "made.bvh"), str(self.folder / "made.glb")]
        armature = self._armature()
        if armature is None:
            return
        body = ArmatureBody(armature)
        if body.has(read_take(self._takes("made")[0]).names):
            return
        rest = self.folder / "rest.bvh"
        self.bones = body.write_rest(rest)
        files = [str(file) for file in self._takes("made")]
        fitted = str(self.folder / "fitted.bvh")
        yield [self.command, "retarget", *files, "--to", str(rest), "-o", fitted]

    def finish(self, context: bpy.types.Context) -> list[bpy.types.Action]:
        """Makes Actions of the motions for the armature, or for a new mannequin, and returns them.

        Raises:
            ValueError: The armature is gone, or has no bones.
        """
        armature = self._armature()
        if armature is None:
            # The figure without its animation: its Actions are made as for any armature.
            objects, old_actions = {*bpy.data.objects}, {*bpy.data.actions}
            properties = bpy.ops.import_scene.gltf.get_rna_type().properties.keys()
            options = {"disable_bone_shape": True} if "disable_bone_shape" in properties else {}
            bpy.ops.import_scene.gltf(filepath=str(self.folder / "made.glb"), **options)
            new = [item for item in bpy.data.objects if item not in objects]
            armature = next(item for item in new if item.type == "ARMATURE")
            armature.animation_data_clear()
            for action in [action for action in bpy.data.actions if action not in old_actions]:
                bpy.data.actions.remove(action)
            for bone in armature.pose.bones:
                bone.matrix_basis.identity()
            armature.location = context.scene.cursor.location
            armature.name = "Latent Motion"
        files = self._takes("made" if self.bones is None else "fitted")
        takes = [read_take(file) for file in files]
        start = context.scene.frame_start
        name = self.settings["prompt"].strip() or self.settings["model"]
        if self.settings["directed_by"] == "MARKERS":
            name = "Timeline"
        actions = []
        for number, take in enumerate(takes, 1):
            body = ArmatureBody(armature)
            bones = {bone: bone for bone in body.names} if self.bones is None else self.bones
            label = f"{name} {number}" if number > 1 else name
            actions.append(make_action(armature, label, body.carry(take, bones), start))
        armature.animation_data.action = actions[0]
        longest = max(len(take.rotations) for take in takes)
        context.scene.frame_end = max(context.scene.frame_end, start + longest - 1)
        return actions

    def clear(self) -> None:
        """Ends the job and deletes its files."""
        self.job.cancel()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _armature(self) -> bpy.types.Object | None:
        """Returns the armature that was selected when the button was pressed."""
        if self.target is None:
            return None
        armature = bpy.data.objects.get(self.target)
        if armature is None:
            raise ValueError(f"the armature {self.target} is gone; select another")
        return armature

    def _takes(self, stem: str) -> list[Path]:
        """Returns the files of all takes: one, or numbered from 1 on."""
        numbered = self.folder.glob(f"{stem}*.bvh")
        return sorted(numbered, key=lambda path: (len(path.name), path.name))


_SETTINGS = ("prompt", "seconds", "seed", "takes", "model", "directed_by")


def target_of(context: bpy.types.Context) -> bpy.types.Object | None:
    """Returns the selected armature, or the armature of the selected mesh."""
    active = context.view_layer.objects.active
    if active is None or not active.select_get():
        return None
    armature = active if active.type == "ARMATURE" else active.find_armature()
    return armature if armature is not None and len(armature.data.bones) else None


def stop() -> None:
    """Ends the running job, if any."""
    if GenerationTask.running is not None:
        GenerationTask.running.clear()
        GenerationTask.running = None


class GenerateMotions(bpy.types.Operator):
    """Make the motion and put it on the selected armature, or on a new mannequin."""

    bl_idname = "latentmotion.generate"
    bl_label = "Generate"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 (Blender wants a set)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Returns whether the button can be pressed: one job at a time."""
        return GenerationTask.running is None and context.mode in {"OBJECT", "POSE"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Starts the job; without a window, as in scripts, returns when it is done."""
        GenerationTask.error = ""
        try:
            GenerationTask.running = GenerationTask(context)
            if bpy.app.background or context.window is None:
                GenerationTask.running.job.wait()
                return self._finished(context)
        except (OSError, ValueError) as error:
            return self._failed(str(error))
        manager = context.window_manager
        self._timer = manager.event_timer_add(_SECONDS_BETWEEN_LOOKS, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Polls the job on timer events; all other events go to Blender."""
        if GenerationTask.running is None:
            return self._over(context, {"CANCELLED"})
        if event.type == "ESC":
            stop()
            return self._over(context, {"CANCELLED"})
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            done = GenerationTask.running.job.is_done()
            return self._over(context, self._finished(context)) if done else {"PASS_THROUGH"}
        except (OSError, ValueError) as error:
            return self._over(context, self._failed(str(error)))

    def _finished(self, context: bpy.types.Context) -> set[str]:
        task = GenerationTask.running
        if task.job.error:
            return self._failed(task.job.error)
        actions = task.finish(context)
        stop()
        self.report({"INFO"}, f"made {', '.join(action.name for action in actions)}")
        return {"FINISHED"}

    def _failed(self, message: str) -> set[str]:
        stop()
        GenerationTask.error = message
        self.report({"ERROR"}, message)
        return {"CANCELLED"}

    def _over(self, context: bpy.types.Context, result: set[str]) -> set[str]:
        context.window_manager.event_timer_remove(self._timer)
        for area in context.screen.areas:
            area.tag_redraw()
        return result


class Cancel(bpy.types.Operator):
    """End the job that runs (or press Esc)."""

    bl_idname = "latentmotion.cancel"
    bl_label = "Cancel"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Ends the running job."""
        stop()
        return {"FINISHED"}


class Panel(bpy.types.Panel):
    """The tab in the 3D view's sidebar (N): prompt, length, seed, takes, model, and the button."""

    bl_idname = "VIEW3D_PT_latentmotion"
    bl_label = "Latent Motion"
    bl_category = "Latent Motion"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"

    def draw(self, context: bpy.types.Context) -> None:
        """Draws the fields and buttons of the panel."""
        layout, settings = self.layout, context.scene.latentmotion
        layout.use_property_split = True
        layout.prop(settings, "prompt")
        column = layout.column(align=True)
        for name in ("seconds", "seed", "takes"):
            column.prop(settings, name)
        layout.prop(settings, "directed_by")
        layout.prop(settings, "model")
        target = target_of(context)
        layout.label(
            text=f"Onto {target.name}" if target else "Onto a new mannequin", icon="ARMATURE_DATA"
        )
        if GenerationTask.running is not None:
            layout.label(text="Generating ...", icon="SORTTIME")
            layout.operator(Cancel.bl_idname, icon="CANCEL")
        else:
            layout.operator(GenerateMotions.bl_idname, icon="PLAY")
        for line in textwrap.wrap(GenerationTask.error, _LINE):
            layout.label(text=line, icon="ERROR")


CLASSES = (GenerateMotions, Cancel, Panel)
