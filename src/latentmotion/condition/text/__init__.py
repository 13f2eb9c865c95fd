"""Sentences → embeddings: the starter's own student, and the pretrained encoders of the papers."""
