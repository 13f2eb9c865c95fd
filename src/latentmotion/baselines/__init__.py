"""What the paper compares with, on the same interfaces and trained by the same commands."""
