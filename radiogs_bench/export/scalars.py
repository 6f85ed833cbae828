"""The course of a cell's training and its end as named values by step, for loggers."""

from collections.abc import Iterator
from dataclasses import dataclass

from ..store.schema import Result


@dataclass(frozen=True)
class Scalars:
    """Values at one step of a stage, by ``loss/NAME`` and, where the model was scored then, ``TASK/MEASURE``."""

    stage: str
    step: int
    values: dict[str, float]


def course(result: Result) -> Iterator[Scalars]:
    """Every point of the trail, stage by stage."""
    for stage, points in result["trail"].items():
        for point in points:
            losses = {f"loss/{name}": value for name, value in point["losses"].items()}
            yield Scalars(stage, point["iteration"], losses | point["metrics"])


def end(result: Result) -> dict[str, float]:
    """The finished model's metrics that have a value."""
    return {name: each["value"] for name, each in result["metrics"].items() if each["value"] is not None}
