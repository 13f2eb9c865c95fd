"""A benchmark of directed motion: 1,000 cases of five kinds, and what a model makes of them."""
