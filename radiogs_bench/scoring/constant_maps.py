"""Scores of constant maps: a recovered map that scores no better carries no information.

``roughness/constant`` is the error of the one roughness that suits all test views best, ``environment/constant`` that
of the best light that is the same from all directions, each under the protocol of the metric it is compared with.
"""

import math

from radiogs_core.scene.light import texel_solid_angles
from radiogs_core.scene.scene import Scene, View

from .metrics.protocol import Protocol
from .metrics.values import Value
from .metrics_by_view import MetricsByView
from .score_maps import coverage, truth


def score_constant_roughness(scores: MetricsByView, scene: Scene) -> None:
    """Score the roughness whose error, summed over the test views, is least. Nothing where a view has no true one."""
    views = [view for view in scene.test if view.has("roughness")]
    if not views or len(views) < len(scene.test):
        return
    best = _best_constant(scores.rules, views)
    for view in views:
        value = Value(None, "no view shows a roughness") if best is None else _error(scores.rules, view, best)
        scores.add("roughness", view.name, {"constant": value})


def score_constant_light(scores: MetricsByView, scene: Scene) -> None:
    """Score the mean of the true light, which no constant light is closer to."""
    if scene.training_light is None:
        return
    light = scene.training_light.radiance.cpu().double()
    weight = texel_solid_angles(*light.shape[:2], dtype=light.dtype)[..., None].expand(light.shape)
    mean = (weight * light).sum((0, 1)) / weight.sum((0, 1))
    error = scores.rules.score_environment(mean.expand_as(light), light)["error_scaled"]
    scores.add_whole("environment", {"constant": error})


def _best_constant(rules: Protocol, views: list[View]) -> float | None:
    """The error of a constant is a parabola in it: three of its values give its lowest point.

    None where a view has no value or none depends on the constant.
    """
    found = [[_error(rules, view, constant).value for view in views] for constant in (0.0, 0.5, 1.0)]
    sums = [math.fsum(each for each in of_views if each is not None) for of_views in found]
    curvature = sums[0] - 2 * sums[1] + sums[2]
    if any(each is None for of_views in found for each in of_views) or curvature <= 0:
        return None
    return 0.5 - (sums[2] - sums[0]) / (4 * curvature)


def _error(rules: Protocol, view: View, constant: float) -> Value:
    target, mask = truth(view, "roughness"), coverage(view)
    return rules.score_roughness(constant * mask, target, mask)["mse"]
