"""Latent Motion in Blender: a sentence becomes an Action, made by the `latentmotion` command.

command.py     finds the command, runs it beside Blender
bvh.py         the motion files that go to and fro
bones.py       a motion's turns of joints -> turns of an armature's bones
actions.py     those as an Action's curves
settings.py    what the panel asks for; the add-on's preferences
generate.py    the operator that joins them
panel.py       the sidebar
"""

import bpy

from . import generate, panel, settings

bl_info = {
    "name": "Latent Motion",
    "author": "Latent Motion",
    "version": (0, 1, 0),
    "blender": (4, 2, 0),
    "location": "3D View > Sidebar > Latent Motion",
    "description": "Turn a sentence into motion for your character",
    "category": "Animation",
}

_CLASSES = (settings.Settings, settings.Preferences, *generate.CLASSES, panel.Panel)


def register() -> None:
    """Adds the panel, its operators and its settings to Blender."""
    for each in _CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Scene.latentmotion = bpy.props.PointerProperty(type=settings.Settings)


def unregister() -> None:
    """Takes all of it away again."""
    generate.stop()
    del bpy.types.Scene.latentmotion
    for each in reversed(_CLASSES):
        bpy.utils.unregister_class(each)
