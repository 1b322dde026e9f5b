"""Prepare: a raw frame becomes one finite image with a validity mask, in one order.

no data → defects → low-pass → light
"""
