"""Parts of benchmarks/honest.py: pairs with truth, pairs without, plain correlation, measures."""
