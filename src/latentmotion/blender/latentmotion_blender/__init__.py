"""Latent Motion in Blender: a sentence becomes an Action, made by the `latentmotion` command.

command.py     finds the command and runs it in the background
bvh.py         reads takes and writes rest poses
directing.py   empties, a curve and markers -> a scene file
bones.py       rotations of a motion's joints -> rotations of an armature's bones
actions.py     these rotations as an Action's curves
settings.py    the panel's fields and the add-on's preferences
generate.py    the operator and the sidebar
"""

import bpy

from . import generate, settings

bl_info = {
    "name": "Latent Motion",
    "author": "Latent Motion",
    "version": (1, 0, 0),
    "blender": (4, 2, 0),
    "location": "3D View > Sidebar > Latent Motion",
    "description": "Turn a sentence into motion for your character",
    "category": "Animation",
}

_CLASSES = (settings.AddonSettings, settings.Preferences, *generate.CLASSES)


def register() -> None:
    """Adds the panel, its operators and its settings to Blender."""
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.latentmotion = bpy.props.PointerProperty(type=settings.AddonSettings)


def unregister() -> None:
    """Removes all classes and properties of the add-on."""
    generate.stop()
    del bpy.types.Scene.latentmotion
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
