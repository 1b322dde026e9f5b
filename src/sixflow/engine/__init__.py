"""The engine: compiled kernels of one least-squares pass over a frame pair.

`spline` (prefilter) → `blend` (dense map from local affine maps) → `warp` (moved frame onto the
reference, gradients, residual) → `moments` (Gaussian window sums at grid points) → `solve` (six numbers
and covariance per point).

Every kernel works on a range of rows without holding Python's lock; `threads` hands fixed strips of
rows to a pool, so that the numbers do not depend on how many processors there are.
"""
