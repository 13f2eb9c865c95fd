"""The panel's fields, and the preference for the `latentmotion` command."""

from pathlib import Path

import bpy

from .command import find_command

MISSING = (
    "The latentmotion command was not found. Install it (pip install latentmotion) and set its "
    "path in Preferences > Add-ons > Latent Motion"
)


class AddonSettings(bpy.types.PropertyGroup):
    """The panel's fields."""

    prompt: bpy.props.StringProperty(
        name="Prompt",
        description="What the person does, in a sentence",
        default="a person walks forward",
    )
    seconds: bpy.props.FloatProperty(
        name="Seconds", description="Length of the motion", default=4, min=0.5, soft_max=10
    )
    seed: bpy.props.IntProperty(
        name="Seed", description="The same seed gives the same motion again", default=0, min=0
    )
    takes: bpy.props.IntProperty(
        name="Takes",
        description="How many motions to make, each an Action, with seeds that count up",
        default=1,
        min=1,
        soft_max=10,
    )
    directed_by: bpy.props.EnumProperty(
        name="Directed by",
        items=[
            ("SENTENCE", "Sentence", "The sentence is all"),
            (
                "GOALS",
                "Goals",
                "Keyed empties named after joints, such as right_wrist, and a curve named path",
            ),
            ("MARKERS", "Markers", "Each marker's name is what the person does until the next"),
        ],
    )
    model: bpy.props.StringProperty(
        name="Model", description="Name or folder of the model", default="fast"
    )


class Preferences(bpy.types.AddonPreferences):
    """The path of the command."""

    bl_idname = __package__

    command: bpy.props.StringProperty(
        name="Command",
        description="The latentmotion command or its environment; if empty it is looked for",
        subtype="FILE_PATH",
    )

    def draw(self, context: bpy.types.Context) -> None:
        """Draws the path and the command found there."""
        self.layout.prop(self, "command", text="latentmotion command")
        command = command_of(context)
        icon = "CHECKMARK" if command else "ERROR"
        self.layout.label(text=command or "not found: pip install latentmotion", icon=icon)


def command_of(context: bpy.types.Context) -> str | None:
    """Returns the path of the command, or None."""
    addon = context.preferences.addons.get(__package__)
    preferred = addon.preferences.command if addon and addon.preferences else ""
    opened = bpy.data.filepath
    return find_command(bpy.path.abspath(preferred), Path(opened).parent if opened else None)
