"""Scoring of takes by their sentence, and search among motions, without PyTorch."""
