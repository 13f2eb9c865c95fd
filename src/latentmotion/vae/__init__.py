"""Motion and latents."""
