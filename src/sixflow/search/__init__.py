"""Search: large motion, from nothing or from a first guess to a field that refinement has finished.

| module | what |
|---|---|
| `stage` | what is tried, and when |
| `shift` | the displacement that two frames have in common |
| `pyramid` | coarse to fine, from a start |
| `spectrum` | turn, zoom and shear from amplitude spectra, which do not move with the shift |
| `tiles` | where tiles of frame 0 are in frame 1, and the affine map that they agree upon |
| `plane` | candidates of `spectrum`, judged by `tiles`: one affine map of whole frames |
| `growth` | from where the motion is found to where it is not yet |
| `guess` | a first guess of any kind, at the grid points |
"""
