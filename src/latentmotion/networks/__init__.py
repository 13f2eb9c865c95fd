"""Networks made of their configurations; needs PyTorch."""
