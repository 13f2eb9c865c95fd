"""Captions and prompts of clips, written and drawn for training."""
