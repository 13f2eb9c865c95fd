"""Files of motion, one module per format, reader and writer side by side."""
