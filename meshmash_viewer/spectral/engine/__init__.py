"""Implementation of `meshmash_viewer.spectral.eigensolver`, in reading order.

`request` checks the arguments, `pencil` reduces (L, M) to one symmetric matrix in natural units,
`symbolic`, `multifrontal` and `factorization` order and factor shifted copies of it and count
eigenvalues, `plan` cuts the spectrum into slices by such counts, `lanczos` finds all pairs of
slices in parallel, `output` makes them final, and `computation` does all of it. `compiler` compiles
kernels; `arnoldi` uses an inverse given by the caller.
"""
