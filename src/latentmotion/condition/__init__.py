"""Sentences, labels or nothing become tokens that steer the diffusion."""
