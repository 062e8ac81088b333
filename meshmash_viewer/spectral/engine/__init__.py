"""Implementation of `meshmash_viewer.spectral.eigensolver`, in reading order.

`request` checks the arguments. `pencil` reduces (L, M) to one symmetric matrix in natural units.
`symbolic`, `multifrontal` and `factorization` order and factor shifted copies of the matrix and
count eigenvalues. `plan` divides the spectrum into slices by these counts, `lanczos` finds the
pairs of slices in parallel, and `output` scales and writes the pairs. `computation` calls all these
modules. `compiler` compiles kernels; `arnoldi` uses an inverse given by the caller.
"""
