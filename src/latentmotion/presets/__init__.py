"""Experiments ready to train."""
