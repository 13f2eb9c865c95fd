"""Networks without PyTorch: graphs, batches, the text encoder and its cache, predicted lengths."""
