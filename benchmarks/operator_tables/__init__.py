"""The tables of benchmarks/operators.py, one module each."""
