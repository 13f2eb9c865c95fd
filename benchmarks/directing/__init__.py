"""Experiments of directing: goals, kept frames, timelines, streams, loops, fits, length, search.

Each measures rows of motions, those of the method beside no goals, linear interpolation and real
ones, on the test split of any data set with captions.
"""
