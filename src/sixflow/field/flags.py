"""Flags: what happened at a grid point, one bit each."""

FLAGS = {
    "masked": 1,
    "border": 2,
    "low_texture": 4,
    "unmatched": 8,
    "outlier": 16,
    "not_converged": 32,
}
"""Meaning of each bit of `flag`.

masked: the point lies outside the region of interest, or on pixels without a value. border: part of the
window lies outside the frame, the mask or the other frame; the value stands, with its larger covariance.
low_texture: the window's texture does not rise above the noise. unmatched: the point or most of its window
has left the other frame, or the windows do not look alike. outlier: the point contradicts its neighbours.
not_converged: the last pass still moved the point.
"""

FAILING = (
    FLAGS["masked"] | FLAGS["low_texture"] | FLAGS["unmatched"] | FLAGS["outlier"] | FLAGS["not_converged"]
)
"""Bits that make a point NaN; `border` alone does not."""
