"""A prepared folder as one small file: joints on a grid, directions of bones, coded in time."""
