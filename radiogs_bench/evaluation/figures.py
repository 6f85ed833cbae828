"""Figures of single test views, gathered until there is one for every view, and those of the scene as a whole."""

from collections import defaultdict
from collections.abc import Mapping, Sequence

from ..metrics import Protocol, Value
from ..store.schema import MetricValue


class Figures:
    """Figures by metric (``task/measure``) and view; a view may get several, which are averaged (one a light).

    ``views`` are the test views. ``elsewhere`` are views that only some tasks have, instead of the test views.
    """

    def __init__(self, rules: Protocol, views: Sequence[str], elsewhere: Sequence[str] = ()) -> None:
        self.rules = rules
        self.groups = (tuple(views), tuple(elsewhere))
        self.views = (*views, *elsewhere)
        self._found: dict[str, dict[str, list[Value]]] = defaultdict(lambda: defaultdict(list))
        self._whole: dict[str, Value] = {}

    def add(self, task: str, view: str, scores: Mapping[str, Value]) -> None:
        """Put in one view's figures of a task, by measure."""
        for measure, value in scores.items():
            self._found[f"{task}/{measure}"][view].append(value)

    def add_whole(self, task: str, scores: Mapping[str, Value]) -> None:
        """Put in figures of the scene as a whole, which no view has."""
        self._whole |= {f"{task}/{measure}": value for measure, value in scores.items()}

    def metrics(self) -> dict[str, MetricValue]:
        """The mean over views of every metric that any view has a figure for, and the figures of the whole."""
        found = {name: self._metric(name, by_view) for name, by_view in self._found.items()}
        nowhere: list[float | None] = [None] * len(self.views)
        for name, value in self._whole.items():
            found[name] = MetricValue(value=value.value, reason=value.reason or None, views=nowhere)
        return dict(sorted(found.items()))

    def _metric(self, name: str, by_view: Mapping[str, list[Value]]) -> MetricValue:
        expected = [view for group in self.groups if by_view.keys() & set(group) for view in group]
        values = {view: self._value(by_view.get(view, [])) for view in expected}
        mean = self.rules.mean(list(values.values()), name)
        figures = [values[view].value if view in values else None for view in self.views]
        return MetricValue(value=mean.value, reason=mean.reason or None, views=figures)

    def _value(self, values: Sequence[Value]) -> Value:
        return self.rules.mean(values) if values else Value(None, "not every test view has this ground truth")
