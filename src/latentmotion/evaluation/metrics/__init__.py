"""Metrics of evaluations, one file per subject."""
