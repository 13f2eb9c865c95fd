"""Bodies with a surface: SMPL model files that users bring, and skin that follows bones."""
