"""Metrics that a scene without masks cannot have, and why: its light is not distant."""

from radiogs_core.scene.scene import Scene

from .metrics.values import Value
from .metrics_by_view import MetricsByView

NOT_DISTANT = "the scene has no masks: what lights it is part of the model, and not a distant light"


def withhold_light(scores: MetricsByView, scene: Scene) -> None:
    """n/a with the reason, for relighting, the recovered light and the albedo under it, where surroundings are learnt.

    An environment map would light such a model from outside the walls that it has learnt.
    """
    if not scene.surrounded:
        return
    rules, light = scores.rules, Value(None, NOT_DISTANT)
    for task in ("relight", "albedo"):
        scores.add_whole(task, rules.no_comparison(NOT_DISTANT))
    measures = ("error", "error_scaled", "irradiance", "reflection")
    scores.add_whole("environment", dict.fromkeys(measures, light))
