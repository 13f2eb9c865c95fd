"""The instruction benchmark: does a motion do what its sentence says? NumPy only, no PyTorch."""
