"""Storage on disk: atomic files, JSON, caches, pickles of plain values, provenance."""
