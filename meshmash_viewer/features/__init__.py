"""Computations with eigenpairs: filters, features, truncation errors, comparison of shapes."""
