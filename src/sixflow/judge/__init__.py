"""Judge: which points of a field were measured, and which were not, with the reason."""
