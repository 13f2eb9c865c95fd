"""The describer: acts of a motion measured from its joints and put into words; NumPy only."""
