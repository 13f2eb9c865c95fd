"""Latent Motion: sentences become 3D human motion, by diffusion in a VAE's latent space."""

__version__ = "0.1.0"
