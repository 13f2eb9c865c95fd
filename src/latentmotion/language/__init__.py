"""Sentence → request: acts, sides, turns and counts that English asks for. English is read here."""
