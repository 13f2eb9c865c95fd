"""Tests: a folder for each room of the package; what several of them need is in `support`."""
