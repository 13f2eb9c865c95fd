"""Retrieval of a caption's own clip, by a motion tower that serves for nothing else."""
