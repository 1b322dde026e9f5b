"""Refine: passes at full resolution, from a field that is near to the one that fits best, with its covariance."""
