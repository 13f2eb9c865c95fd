"""Joints → events: what a motion shows, in numbers. No English."""
