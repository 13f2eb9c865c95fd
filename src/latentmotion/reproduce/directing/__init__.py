"""Experiments of directing: goals, kept frames, timelines, streams, loops, fits, length, search.

Each measures rows of motions, those of the method beside no goals, linear interpolation and real
ones, on the test split of any data set with captions.
"""

EXPERIMENTS = {
    "goals": ("goals of joints and paths", "goals:goal_rows"),
    "keep": ("frames that are kept", "keep:keep_rows"),
    "timelines": ("several prompts in one motion", "sequences:timeline_rows"),
    "stream": ("minutes of one motion", "sequences:stream_rows"),
    "loops": ("seamless cycles", "sequences:loop_rows"),
    "fit": ("noisy and missing joints", "fits:fit_rows"),
    "length": ("seconds predicted from the sentence", "sentences:length_rows"),
    "search": ("clips found by a sentence", "sentences:search_rows"),
}
"""Title and `module:function` of each experiment, by name."""
