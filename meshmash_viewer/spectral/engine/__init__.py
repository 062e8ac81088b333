"""The machinery behind `meshmash_viewer.spectral.eigensolver`, in reading order.

`request` checks what is asked, `pencil` reduces (L, M) to one symmetric matrix in natural units,
`symbolic`, `multifrontal` and `factorization` order and factor shifted copies of it and count
eigenvalues, `plan` cuts the spectrum into slices by such counts, `lanczos` finds all pairs of
slices side by side, `output` makes them final, and `run` drives it all.
`workers` says how many slices run at once, `compiler` how kernels are made; `arnoldi` serves an
inverse given from outside.
"""
