"""Measures of motion, real and generated."""
