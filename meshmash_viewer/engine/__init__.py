"""The machinery behind `meshmash_viewer.eigensolver`: what it stands on, in reading order.

`pencil` reduces (L, M) to one symmetric matrix and knows its null space, `factorization` factors
shifted copies of it and counts eigenvalues.
"""
