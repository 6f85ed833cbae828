"""``radiogs-bench run``: bring a suite's cells to their end, then write and show its table."""

import argparse
from pathlib import Path

from radiogs.errors import UsageError


def run(options: argparse.Namespace) -> int:
    """Run or continue a suite; returns the exit code."""
    from ..suites import SUITES, suite
    from .reporter import say

    if options.list:
        for each in SUITES.values():
            say(f"{each.name}: {each.title} ({len(each.rows)} rows, {len(each.columns)} metrics)")
        return 0
    if options.suite is None:
        raise UsageError("no suite was named", "", "See them all:  radiogs-bench run --list")
    chosen = suite(options.suite)
    folder = options.out or Path("out") / chosen.name

    from ..store import Store
    from .sweeping import bring_to_end, plan, show_plan

    request, device = plan(options, chosen)
    store = Store(folder)
    if options.dry_run:
        show_plan(request, store)
        return 0
    return bring_to_end(request, store, device)
