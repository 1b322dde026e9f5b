"""Pair: the measurement of one pair of frames, body by body."""
