"""What a motion does, measured from its joints, and told in sentences; NumPy only."""
