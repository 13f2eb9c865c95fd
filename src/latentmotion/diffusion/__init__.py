"""Noise and latents."""
