"""How a process of a run starts another one that does a part of the run (``cli/child.py``)."""

import sys

CHILD = (sys.executable, "-P", "-m", "radiogs_bench.cli.child")
"""Begins the command line of such a process: the installed code, and no module of the folder where the process is
started, whatever it is called."""
