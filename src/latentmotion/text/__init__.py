"""Text encoding without PyTorch: the exported encoder, its vocabulary, cache and length model."""
