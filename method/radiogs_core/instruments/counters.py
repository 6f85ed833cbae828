"""Deterministic work counters: what a run cost, apart from how fast the machine was."""

from collections import Counter

work: Counter[str] = Counter()
"""Work done by this process since it was last cleared.

rays; probe_rays, those of them that probes of effects traced; node_visits and leaf_visits of their traversal; hits that
were blended. blended_pairs: surfels times pixels. shaded_samples: surfels times views times directions; lobes: those of
surfels that have a specular part. bytes_read: of nodes, leaves, surfels and samples, each time that one is used (caches
may serve most of it).
"""


def count(**amounts: int) -> None:
    """Add to the counters."""
    work.update(amounts)


fired: Counter[str] = Counter()
"""How often each guard of ``radiogs_core.guards`` acted in this process since this was last cleared."""


def fire(**amounts: int) -> None:
    """Add to the guards' counters; what did not happen leaves no entry."""
    fired.update({name: amount for name, amount in amounts.items() if amount})
