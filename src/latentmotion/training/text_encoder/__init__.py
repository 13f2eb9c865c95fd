"""Distillation of the small text encoder: captions, variations, teacher targets, training."""
