"""Nearest clips of the training data: what a sentence may start from, and whether it is known."""
