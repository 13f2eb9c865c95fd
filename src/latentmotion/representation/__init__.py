"""Joints and features: how a pose becomes numbers a network can learn."""
