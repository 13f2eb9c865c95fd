"""Trained networks without PyTorch: export and sessions."""
