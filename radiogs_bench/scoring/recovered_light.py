"""Scores a recovered environment map: its texels, and the light that it sends to the surfaces of the test views.

The error of texels is dominated by the sun, whose sharpness diffuse surfaces hide and whose texels a coarse map cannot
hold; the light that surfaces receive is compared, too.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import normalize

from radiogs_core.scene.light import EnvironmentMap, texel_directions, texel_solid_angles
from radiogs_core.scene.scene import Scene, View

from .metrics.environment import at_rows, averaged, glossy_reflection, irradiance, relative_squared_error
from .metrics.protocol import Protocol, inside
from .metrics.values import Value
from .metrics_by_view import MetricsByView
from .score_maps import coverage

PIXELS = 4096
"""Pixels of all test views together, background included, at which the light on surfaces is compared."""

ROWS = 64
"""Rows of the grid over which the light on surfaces is integrated: as many as the finest learnt map has."""

GLOSSY = 0.5
"""Largest perceptual roughness of a surface whose reflections count."""

SHARPEST = 0.2
"""Least roughness of the blur of reflections: its lobe is two texels of ROWS wide at half height."""

GOLDEN = (math.sqrt(5) - 1) / 2
"""Fractional parts of its multiples are evenly spread."""

BLACK = "the true light is black"

NOT_DISTANT = "the scene has no masks: what lights it is part of the model, and not a distant light"
"""Why relighting and recovered light have no metrics in a scene without masks."""


@dataclass(frozen=True)
class SeenSurface:
    """Points of the true surfaces that the test views show, in the world, float64."""

    normals: Float[Tensor, "points 3"]
    """Unit normals."""
    mirrored: Float[Tensor, "points 3"]
    """Unit directions into which a mirror would reflect the ray from the camera."""
    roughness: Float[Tensor, "points 1"]
    """Perceptual roughness; NaN where it is not known."""


def score_light(by_protocol: Sequence[MetricsByView], scene: Scene, found: EnvironmentMap) -> None:
    """Score a recovered environment map under each protocol, if the true one is known and distant."""
    true = scene.training_light
    if true is None or scene.surrounded:
        return
    radiance, seen = true.radiance.cpu(), seen_surface(scene.test)
    for scores in by_protocol:
        whole = scores.rules.score_environment(_like(radiance, found), radiance)
        floor = {"floor": resolution_floor(scores.rules, radiance, *found.radiance.shape[:2])}
        scores.add_whole("environment", whole | floor | score_light_on_surfaces(scores.rules, seen, found, true))


def score_constant_light(scores: MetricsByView, scene: Scene) -> None:
    """Score the mean of the true light, the best constant estimate."""
    if scene.training_light is None:
        return
    light = scene.training_light.radiance.cpu().double()
    weight = texel_solid_angles(*light.shape[:2], dtype=light.dtype)[..., None].expand(light.shape)
    mean = (weight * light).sum((0, 1)) / weight.sum((0, 1))
    error = scores.rules.score_environment(mean.expand_as(light), light)["error_scaled"]
    scores.add_whole("environment", {"constant": error})


def withhold_light(scores: MetricsByView, scene: Scene) -> None:
    """Give the reason why relighting, recovered light and albedo are n/a for a model that learns its surroundings."""
    if not scene.surrounded:
        return
    for task in ("relight", "albedo"):
        scores.add_whole(task, scores.rules.no_comparison(NOT_DISTANT))
    measures = ("error", "error_scaled", "irradiance", "reflection")
    scores.add_whole("environment", dict.fromkeys(measures, Value(None, NOT_DISTANT)))


def resolution_floor(rules: Protocol, truth: Float[Tensor, "height width 3"], rows: int, columns: int) -> Value:
    """The error, up to scale, of the true light averaged to a map of this size and interpolated like recovered maps."""
    coarse = EnvironmentMap(averaged(truth, rows, columns))
    return rules.score_environment(_like(truth.double(), coarse), truth)["error_scaled"]


def score_light_on_surfaces(
    rules: Protocol, seen: SeenSurface, found: EnvironmentMap, true: EnvironmentMap
) -> dict[str, Value]:
    """``irradiance`` and ``reflection``: relative squared errors of the recovered light's effect on seen surfaces.

    Irradiance is unshadowed. Reflection is radiance averaged over the GGX lobe of the true roughness around the mirror
    direction, at points whose roughness is at most GLOSSY. Each is compared after the protocol's alignment, by
    least squares over its own values.
    """
    reason = _without(seen)
    if not len(seen.normals):
        return dict.fromkeys(("irradiance", "reflection"), Value(None, reason))
    ours, theirs = at_rows(found, ROWS), at_rows(true, ROWS)
    received = irradiance(ours, seen.normals), irradiance(theirs, seen.normals)
    scores = {"irradiance": _error(rules, *received), "reflection": Value(None, reason)}
    if not reason:
        glossy = seen.roughness[:, 0] <= GLOSSY
        lobes = seen.mirrored[glossy], seen.roughness[glossy].clamp(min=SHARPEST)
        scores["reflection"] = _error(rules, glossy_reflection(ours, *lobes), glossy_reflection(theirs, *lobes))
    return scores


def _error(rules: Protocol, ours: Float[Tensor, "points 3"], theirs: Float[Tensor, "points 3"]) -> Value:
    return inside(relative_squared_error(ours, theirs, rules.environment), BLACK)


def seen_surface(views: Sequence[View]) -> SeenSurface:
    """Points at evenly spread pixels that the truth covers by more than half; none in views without true normals."""
    share = PIXELS / max(PIXELS, sum(view.camera.width * view.camera.height for view in views))
    points = [_points(view, share) for view in views if view.has("normal")]
    none = torch.empty(0, 7, dtype=torch.float64)
    normals, mirrored, roughness = torch.cat([none, *points]).split([3, 3, 1], -1)
    return SeenSurface(normals, mirrored, roughness)


def _points(view: View, share: float) -> Float[Tensor, "points 7"]:
    """Normal, mirror direction and roughness at a share of a view's pixels, as far as they are covered."""
    solid, normal = coverage(view).flatten() > 0.5, view.read("normal").double().flatten(0, 1)
    chosen = torch.arange(len(solid), dtype=torch.float64) * GOLDEN % 1 < share
    kept = chosen & solid & (normal.norm(dim=-1) > 0)
    normal, ray = normalize(normal[kept], dim=-1), view.camera.ray_directions().double().flatten(0, 1)[kept]
    unknown = torch.full((len(solid), 1), torch.nan)
    roughness = view.read("roughness").flatten(0, 1) if view.has("roughness") else unknown
    mirrored = normalize(ray - 2 * (ray * normal).sum(-1, keepdim=True) * normal, dim=-1)
    return torch.cat([normal, mirrored, roughness[kept].double()], -1)


def _without(seen: SeenSurface) -> str:
    """Why no reflections can be compared; empty if they can."""
    if not len(seen.normals):
        return "no test view shows a surface with a true normal"
    if seen.roughness.isnan().all():
        return "no test view has a true roughness"
    if not (seen.roughness <= GLOSSY).any():
        return f"no visible surface has a roughness of at most {GLOSSY:g}"
    return ""


def _like(truth: Float[Tensor, "height width 3"], found: EnvironmentMap) -> Float[Tensor, "height width 3"]:
    """The recovered light interpolated at the texels of the true light."""
    return found.lookup(texel_directions(*truth.shape[:2], dtype=truth.dtype))
