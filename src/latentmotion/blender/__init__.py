"""The add-on for Blender. It runs inside Blender and imports nothing else of this package."""
