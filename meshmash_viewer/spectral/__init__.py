"""Eigenpairs of a Laplacian: solver, certificates, previews, and estimates of cost and number."""
