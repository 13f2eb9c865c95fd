"""Skeletons and how they move: rotations, kinematics both ways, names of joints, SMPL."""
