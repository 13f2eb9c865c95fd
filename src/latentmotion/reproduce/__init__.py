"""Tables of the paper and of the fast family: one command trains and measures their rows."""
