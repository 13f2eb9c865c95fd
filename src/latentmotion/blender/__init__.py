"""The add-on for Blender, as it is handed out; it runs in Blender and imports nothing of ours."""
