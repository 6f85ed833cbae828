"""Deterministic work counters: what a run cost, apart from how fast the machine was."""

from collections import Counter

work: Counter[str] = Counter()
"""Work done by this process since it was last cleared: rays, node_visits, hits, blended_pairs, shaded_samples."""


def count(**amounts: int) -> None:
    """Add to the counters."""
    work.update(amounts)
