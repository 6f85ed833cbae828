"""Comparing maps with a scene's ground truth under a protocol, whoever made the maps.

Every map goes to the protocol as it appears on black, with both coverages: the ground truth's straight maps are
multiplied by its coverage, predicted ones are multiplied by theirs. Linear radiance (``indirect``) goes as display
sRGB, clipped; albedo as it is, linear. What a prediction lacks is not scored.
"""

from collections.abc import Mapping, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.light import EnvironmentMap, texel_directions
from radiogs_core.scene.scene import Scene, View

from ..metrics import Protocol
from .figures import Figures

Image = Float[Tensor, "height width channels"]
Maps = Mapping[str, Float[Tensor, "height width _"]]

MULTIPLIED = ("normal", "depth", "direct", "indirect")
"""Maps that a scene stores as they appear on black; the others are straight."""


def score_view(figures: Figures, view: View, maps: Maps) -> None:
    """Score what needs no other view, as far as maps and truth exist: new views, normals, roughness, indirect light."""
    rules, mask, alpha = figures.rules, coverage(view), maps.get("alpha")
    indirect = compared_indirect(rules)
    if "image" in maps and view.has("image"):
        figures.add("nvs", view.name, rules.score_image(maps["image"], truth(view, "image"), mask, alpha))
    if "normal" in maps and view.has("normal"):
        figures.add("normal", view.name, rules.score_normal(maps["normal"], truth(view, "normal"), mask, alpha))
    if "roughness" in maps and view.has("roughness"):
        figures.add("roughness", view.name, rules.score_roughness(maps["roughness"], truth(view, "roughness"), mask))
    if indirect in maps and view.has("indirect"):
        ours, theirs = displayed(maps[indirect]), displayed(truth(view, "indirect"))
        figures.add("indirect", view.name, rules.score_image(ours, theirs, mask, alpha, "indirect"))


def score_albedo(figures: Figures, scene: Scene, rendered: Mapping[str, Maps]) -> Float[Tensor, "3"] | None:
    """Align the recovered albedo over all test views that have one and a true one, score it; returns the factor."""
    views = [view for view in scene.test if view.has("albedo") and "albedo" in rendered[view.name]]
    if not views:
        return None
    rules = figures.rules
    truths, masks = [truth(view, "albedo") for view in views], [coverage(view) for view in views]
    predictions = [rendered[view.name]["albedo"] for view in views]
    alphas = [rendered[view.name].get("alpha", mask) for view, mask in zip(views, masks, strict=True)]
    scale = rules.albedo_scale(predictions, truths, masks, alphas)
    for view, prediction, target, mask, alpha in zip(views, predictions, truths, masks, alphas, strict=True):
        figures.add("albedo", view.name, rules.score_albedo(prediction, target, scale, mask, alpha))
    return scale


def score_light(figures: Figures, scene: Scene, found: EnvironmentMap) -> None:
    """Score a recovered environment map where the true one is known, at the true one's resolution."""
    if scene.training_light is None:
        return
    true_light = scene.training_light.radiance.cpu()
    directions = texel_directions(*true_light.shape[:2], dtype=true_light.dtype)
    figures.add_whole("environment", figures.rules.score_environment(found.lookup(directions), true_light))


def score_depth(figures: Figures, scene: Scene, rendered: Mapping[str, Maps]) -> None:
    """Score the depth of all test views that have one and a true one, if the protocol compares depth."""
    views = [view for view in scene.test if view.has("depth") and "depth" in rendered[view.name]]
    if figures.rules.depth is None or not views:
        return
    depths, targets = [rendered[view.name]["depth"] for view in views], [truth(view, "depth") for view in views]
    errors = figures.rules.score_depth(depths, targets, [coverage(view) for view in views])
    for view, error in zip(views, errors, strict=True):
        figures.add("depth", view.name, error)


def lit_views(scene: Scene, views: Sequence[View]) -> dict[str, list[View]]:
    """Those of the views that are given under each light of the scene."""
    lit = {light: [view for view in views if view.has(f"relit/{light}")] for light in scene.lights}
    return {light: views for light, views in lit.items() if views}


def compared_indirect(rules: Protocol) -> str:
    """The rendered map that a protocol compares with the scene's indirect light."""
    incident = rules.indirect is not None and rules.indirect.quantity == "incident"
    return "incident" if incident else "indirect"


def coverage(view: View) -> Float[Tensor, "height width 1"]:
    """The true coverage; one everywhere for a view without an alpha map."""
    if view.has("alpha"):
        return view.read("alpha")
    return torch.ones(view.camera.height, view.camera.width, 1)


def truth(view: View, name: str) -> Image:
    """A ground-truth map on black."""
    image = view.read(name)
    return image if name in MULTIPLIED else image * coverage(view)


def displayed(linear: Image) -> Image:
    """Linear radiance as display sRGB in [0, 1]."""
    return srgb_encode(linear).clamp(0, 1)
