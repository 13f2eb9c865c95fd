"""The loop, its two stages, and what it writes down."""
