"""Starts child processes that do a part of a run (``cli/child.py``)."""

import sys

CHILD = (sys.executable, "-P", "-m", "radiogs_bench.cli.child")
"""First words of a child's command line: they run the installed code, never a module of the folder where the process is
started."""
