"""Figures of single test views, gathered until there is one for every view."""

from collections import defaultdict
from collections.abc import Mapping, Sequence

from .metrics import Protocol, Value
from .schema import MetricValue


class Figures:
    """Figures by metric (``task/measure``) and view; a view may get several, which are averaged (one a light)."""

    def __init__(self, rules: Protocol, views: Sequence[str]) -> None:
        self.rules = rules
        self.views = tuple(views)
        self._found: dict[str, dict[str, list[Value]]] = defaultdict(lambda: defaultdict(list))

    def add(self, task: str, view: str, scores: Mapping[str, Value]) -> None:
        """Put in one view's figures of a task, by measure."""
        for measure, value in scores.items():
            self._found[f"{task}/{measure}"][view].append(value)

    def metrics(self) -> dict[str, MetricValue]:
        """The mean over views of every metric that any view has a figure for."""
        return {name: self._metric(by_view) for name, by_view in sorted(self._found.items())}

    def _metric(self, by_view: Mapping[str, list[Value]]) -> MetricValue:
        values = [self._value(by_view.get(view, [])) for view in self.views]
        mean = self.rules.mean(values)
        return MetricValue(value=mean.value, reason=mean.reason or None, views=[value.value for value in values])

    def _value(self, values: Sequence[Value]) -> Value:
        return self.rules.mean(values) if values else Value(None, "not every test view has this ground truth")
