"""The command line: `sixflow measure`, `plot`, `info`, `demo`, `warm-up` and more.

One module per command. Heavy packages are imported when a command runs, so that `sixflow --help` is quick.
"""

from sixflow.cli.app import main as main

__all__ = ["main"]
