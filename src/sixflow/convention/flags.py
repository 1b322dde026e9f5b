"""Flags: what happened at a grid point, one bit each."""

FLAGS = {
    "masked": 1,
    "border": 2,
    "low_texture": 4,
    "unmatched": 8,
    "outlier": 16,
    "not_converged": 32,
    "residual": 64,
    "edge": 128,
    "unresolved": 256,
    "forward_backward": 512,
    "replaced": 1024,
    "repeated": 2048,
    "bad_frame": 4096,
    "missing": 8192,
    "ambiguous": 16384,
}
"""Meaning of each bit of `flag`.

masked: the point lies outside the region of interest, or on pixels without a value. border: part of the
window lies outside the frame, the mask or the other frame; the value is kept, with its larger covariance.
low_texture: the window's texture does not rise above the noise. unmatched: the point or most of its window
has left the other frame, or the windows do not look alike. outlier: the point contradicts its neighbours in
displacement or gradient, or stands alone among failed ones. not_converged: the last pass still moved the point.
residual: the window's residual is far above what its neighbours' noise explains. edge: the window lies across a motion
edge, or a neighbour's motion fits the pixels beside the point better. unresolved: the motion has structure finer
than the window resolves; the value is kept, but its error may exceed the stated one. forward_backward: the motion
measured back does not return to the point. replaced: the value is not measured but predicted by the neighbours; the
bits that say why stand beside it. ambiguous: another motion fits the window as well, because the texture repeats.
repeated: the two frames are the same to the last bit, which is a copy and no measurement of no motion.
bad_frame: one of the frames cannot be read or used. missing: the point was never written, or is no longer in
the store that the field was read from.
"""

STANDING = FLAGS["border"] | FLAGS["unresolved"] | FLAGS["replaced"]
"""Bits with which a value is kept."""

FAILING = sum(FLAGS.values()) & ~STANDING
"""Bits that make a point NaN, unless it is replaced. A replaced point has one of them too, and is never valid."""
