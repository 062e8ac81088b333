"""Meshes, eigenpairs, features and sessions on disk."""
