"""Directing a motion: goals of joints and paths, kept frames; pure functions of NumPy arrays.

Three operators serve all of them: *reach* moves latents until joints are where they should be,
*keep* holds known latents while others are sampled, *exact* corrects what is left in the joints.
"""
