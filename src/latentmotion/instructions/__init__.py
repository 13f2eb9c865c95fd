"""Drawn instructions that trainings learn from and their checks; the list that they refuse."""
