"""Parts of benchmarks/public.py: reading cases, our settings, peers, measures, targets, tables, figures, page."""
