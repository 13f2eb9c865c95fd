"""The pipeline on PyTorch: networks on a device, CUDA graphs, padding to few shapes."""
