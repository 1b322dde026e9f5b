"""Patterns of grey values known analytically at every real coordinate."""
