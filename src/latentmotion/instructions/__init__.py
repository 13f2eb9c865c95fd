"""The instruction benchmark: how many motions follow their prompts. NumPy only, no PyTorch."""
