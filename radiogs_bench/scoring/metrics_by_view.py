"""Collects metrics of single test views until every view has a value, and metrics of the scene as a whole."""

from collections import defaultdict
from collections.abc import Mapping, Sequence

from ..store.schema import MetricValue
from .metrics.protocol import Protocol
from .metrics.values import Value


class MetricsByView:
    """Values by metric (``task/measure``) and view. Several values of one view, one per light, are averaged.

    ``views`` are the test views. ``elsewhere`` are views that only some tasks have, instead of the test views.
    """

    def __init__(self, rules: Protocol, views: Sequence[str], elsewhere: Sequence[str] = ()) -> None:
        self.rules = rules
        self.groups = (tuple(views), tuple(elsewhere))
        self.views = (*views, *elsewhere)
        self._by_view: dict[str, dict[str, list[Value]]] = defaultdict(lambda: defaultdict(list))
        self._whole: dict[str, Value] = {}
        self._withheld: dict[tuple[str, str], str] = {}

    def withhold(self, task: str, view: str, reason: str) -> None:
        """Give the reason why a view has no values of a task, if it is something other than missing ground truth."""
        self._withheld[task, view] = reason

    def add(self, task: str, view: str, scores: Mapping[str, Value]) -> None:
        """Add a view's values of a task, by measure."""
        for measure, value in scores.items():
            self._by_view[f"{task}/{measure}"][view].append(value)

    def add_whole(self, task: str, scores: Mapping[str, Value]) -> None:
        """Add values of the scene as a whole, which no single view has."""
        self._whole |= {f"{task}/{measure}": value for measure, value in scores.items()}

    def metrics(self) -> dict[str, MetricValue]:
        """Every metric by name: the mean over views and each view's value; or the value of the scene as a whole."""
        found = {name: self._metric(name, by_view) for name, by_view in self._by_view.items()}
        nowhere: list[float | None] = [None] * len(self.views)
        for name, value in self._whole.items():
            found[name] = MetricValue(value=value.value, reason=value.reason or None, views=nowhere)
        return dict(sorted(found.items()))

    def _metric(self, name: str, by_view: Mapping[str, list[Value]]) -> MetricValue:
        task, values = name.rpartition("/")[0], dict[str, Value]()
        for view in (view for group in self.groups if by_view.keys() & set(group) for view in group):
            reason = self._withheld.get((task, view), "not every test view has this ground truth")
            values[view] = self.rules.mean(by_view[view]) if view in by_view else Value(None, reason)
        mean = self.rules.mean(list(values.values()), name)
        of_views = [values[view].value if view in values else None for view in self.views]
        return MetricValue(value=mean.value, reason=mean.reason or None, views=of_views)
