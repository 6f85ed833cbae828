"""A defect of a scene, and the grouping of findings with equal words."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

MOST_ALIKE, FIRST = 8, 3
"""Findings of the same words that are listed one by one, and how many of more are named."""

Severity = Literal["error", "warning"]


@dataclass(frozen=True)
class Finding:
    """A defect of a scene: its place (a file or a view), its description, and whether the scene is still usable."""

    place: str
    what: str
    severity: Severity = "error"


def warning(place: str, what: str) -> Finding:
    """The finding of a defect with which the scene is still usable."""
    return Finding(place, what, "warning")


def grouped(findings: Sequence[Finding]) -> Iterator[Finding]:
    """Findings in their order; more than ``MOST_ALIKE`` findings with equal words become one."""
    alike: dict[tuple[str, Severity], list[str]] = defaultdict(list)
    for finding in findings:
        alike[finding.what, finding.severity].append(finding.place)
    for (what, severity), places in alike.items():
        if len(places) > MOST_ALIKE:
            shown = ", ".join(places[:FIRST])
            yield Finding(f"{len(places)} places", f"{what}; the first {FIRST}: {shown}", severity)
        else:
            yield from (Finding(place, what, severity) for place in places)
