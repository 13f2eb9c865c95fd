"""Trained models: configurations, card and folder, without PyTorch."""
