"""Eigenpairs of a Laplacian: asked for, computed, proved, previewed."""
