"""Blind studies of two models: one page for raters, and the report of their answers."""
