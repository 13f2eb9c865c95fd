"""Data sets as their owners distribute them, one file per source."""
