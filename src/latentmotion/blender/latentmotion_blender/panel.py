"""The tab in the 3D view's sidebar (N)."""

import bpy

from . import generate


class Panel(bpy.types.Panel):
    """Prompt, length, seed, takes, model, and the button."""

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
        target = generate.target_of(context)
        layout.label(
            text=f"Onto {target.name}" if target else "Onto a new mannequin",
            icon="ARMATURE_DATA",
        )
        if generate.is_running():
            layout.label(text="Generating ...", icon="SORTTIME")
            layout.operator(generate.Cancel.bl_idname, icon="CANCEL")
        else:
            layout.operator(generate.GenerateMotions.bl_idname, icon="PLAY")
        for line in generate.last_error():
            layout.label(text=line, icon="ERROR")
