"""The paper's tables and figures, each a list of rows that one command trains and measures."""
