"""The engine: all compiled kernels, and what compiles, keeps and runs them.

| of a pass | what |
|---|---|
| `spline`, `fir` | prefilter of the moved frame |
| `blend` | dense motion from local affine maps |
| `interpolate`, `pixel` | the moved frame at displaced places |
| `rows`, `sweep` | residual, gradient and right-hand side, row by row |
| `moments`, `windows` | sums about nodes, and windows of these |
| `solve` | the six numbers of every window, and their covariance |
| `scales`, `weigh` | weights of pixels |

`neighbours`, `contradiction` and `evidence` serve the judgement, `pixels` and `lowpass` the preparation, `array` the
operators. Every kernel works on a range of rows without holding Python's lock; `threads` shares out fixed strips of
rows, so that the numbers do not depend on how many processors there are.
"""
