"""The families of motion VAEs."""
