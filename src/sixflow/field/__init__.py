"""Field: a dataset of six numbers per point, its flags, times and units, and everything derived from them."""
