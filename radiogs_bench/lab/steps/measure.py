"""Passes over a method at one size, as plain values that a process can hand to another."""

import gc
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol, runtime_checkable

from .estimates import median_of
from .observing import Times
from .passes import one_pass
from .sampling import shares_of
from .sizes import WARM_UP, Size
from .subject import Subject

Plain = dict[str, Any]


@runtime_checkable
class Passing(Protocol):
    """Makes passes, here or in another process."""

    def passed(self, size: str, counts: bool) -> Plain:
        """One pass at a size (see ``Here.passed``)."""


class Here:
    """Passes in this process. ``stages``: how many are gone through, without relighting; None for everything."""

    def __init__(self, subject: Callable[[str], Subject], stages: int | None = None) -> None:
        self._subject, self._stages = subject, stages
        one_pass(subject(WARM_UP.name), lambda titles, work: work())

    def passed(self, size: str, counts: bool) -> Plain:
        """What is measured and where its model lies; seconds and parts by title, and, if asked for, counts."""
        subject = self._subject(size)
        times = Times(subject.device, counts)
        gc.collect()  # not while something is timed
        lies = one_pass(subject, times, self._stages)
        what = {
            "preset": subject.size.preset,
            "side": subject.size.side,
            "views": subject.size.views,
            "surfels": subject.surfels,
            "model": lies,
        }
        return {"what": what, **times.plain()}


def measured(sides: Sequence[Passing], size: Size, passes: int, announce: Callable[[str], None]) -> list[Plain]:
    """The measurements of one or more sides at a size: they take turns, pass by pass. The first pass counts as well."""
    found: list[list[Plain]] = [[] for _ in sides]
    for number in range(passes):
        announce(f"{size.name}: pass {number + 1} of {passes}")
        for side, kept in zip(sides, found, strict=True):
            kept.append(side.passed(size.name, counts=number == 0))
    return [{**kept[0]["what"], "rows": list(_rows(kept))} for kept in found]


def _rows(passes: Sequence[Plain]) -> Iterator[Plain]:
    for title, counted in passes[0]["counts"].items():
        seconds = [each["seconds"][title] for each in passes if title in each["seconds"]]
        parts: dict[str, float] = {}
        for each in passes:
            for part, value in each["parts"].get(title, {}).items():
                parts[part] = parts.get(part, 0.0) + value
        seconds = seconds or [[passes[0]["counted seconds"][title]]]
        middle = median_of(seconds)
        yield {
            "title": title,
            "passes": seconds,
            "median": middle.value,
            "low": middle.low,
            "high": middle.high,
            **counted,
            "parts": shares_of(parts),
        }
