"""Networks to ONNX graphs and a folder that runs without PyTorch."""
