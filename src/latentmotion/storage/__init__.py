"""What is kept on disk: whole files, JSON, caches, pickles of plain values, provenance."""
