"""Detectors of the instruction benchmark, which no training, ranking or clean-up knows."""
