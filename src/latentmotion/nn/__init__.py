"""Blocks shared by `vae` and `diffusion`."""
