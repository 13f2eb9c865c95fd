"""Few-step students of a trained model."""
