"""Running a trained model without PyTorch: graph sessions, padded batches, decoder and scales."""
