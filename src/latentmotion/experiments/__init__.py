"""Tables of the paper and of the fast family: rows that one command trains and measures."""
