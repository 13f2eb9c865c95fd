"""The networks that metrics look through: motions and captions to vectors, motions to labels."""
