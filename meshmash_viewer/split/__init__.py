"""Meshes too large for one go: cut into overlapping pieces, computed apart, and put together."""
