"""Motions with an exact displacement, an exact gradient, an inverse and a course in time."""
