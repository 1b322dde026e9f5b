"""Damaged files: the seeds, their mutants, and what becomes of each."""
