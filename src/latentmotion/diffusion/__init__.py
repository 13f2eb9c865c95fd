"""Noise and latents, and the condition that both follow."""
