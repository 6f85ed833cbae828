"""Compares maps with a scene's ground truth under a protocol, whichever program made the maps.

The protocol receives every map on black, with the coverage of both sides: straight ground-truth maps are multiplied by
the true coverage, predicted maps by their own. Linear radiance (``indirect``) is passed as display sRGB, clipped;
albedo stays linear. Maps that a prediction lacks are not scored.
"""

import math
from collections.abc import Mapping, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.errors import NumericalFailure
from radiogs_core.scene.colour import srgb_decode, srgb_encode
from radiogs_core.scene.scene import Scene, View

from .metrics.protocol import Protocol
from .metrics.psnr import psnr
from .metrics.values import PSNR_CAP, Value
from .metrics_by_view import MetricsByView

Image = Float[Tensor, "height width channels"]
Maps = Mapping[str, Float[Tensor, "height width _"]]

MULTIPLIED = ("normal", "depth", "direct", "indirect")
"""Maps that a scene stores as they appear on black; the others are straight."""


def score_view(scores: MetricsByView, view: View, maps: Maps, extent: float) -> None:
    """Score a view's maps that exist in both prediction and truth. ``extent``: the scene's, world units."""
    rules, mask, alpha = scores.rules, coverage(view), maps.get("alpha")
    indirect = compared_indirect(rules)
    if "image" in maps and view.has("image"):
        image, share = maps["image"], 1.0
        if view.has("valid"):
            valid = view.read("valid")
            image, share = image * valid, float(valid.mean())
            alpha = None if alpha is None else alpha * valid
        found = rules.score_image(image, truth(view, "image"), mask, alpha)
        scores.add("nvs", view.name, found if share == 1 else over_counting(found, share))
    if "normal" in maps and view.has("normal"):
        scores.add("normal", view.name, rules.score_normal(maps["normal"], truth(view, "normal"), mask, alpha))
    if rules.depth_offset is not None and "depth" in maps and view.has("depth"):
        target = truth(view, "depth")
        # Measured depth is zero where it is unknown, and then there is nothing to compare.
        offset = rules.score_depth_offset(maps["depth"], target, mask * (target > 0), extent)
        scores.add("depth", view.name, offset)
    if "roughness" in maps and view.has("roughness"):
        scores.add("roughness", view.name, rules.score_roughness(maps["roughness"], truth(view, "roughness"), mask))
    if indirect in maps and view.has("indirect"):
        ours, theirs = displayed(maps[indirect]), displayed(truth(view, "indirect"))
        scores.add("indirect", view.name, rules.score_image(ours, theirs, mask, alpha, "indirect"))


def over_counting(scores: Mapping[str, Value], share: float) -> dict[str, Value]:
    """Convert values over all pixels to values over the ``share`` that counts, for images that are equal elsewhere.

    Errors elsewhere are zero, so a mean over all pixels is the mean over the pixels that count times their share. This
    holds for the squared error of PSNR exactly, for the dissimilarities of SSIM (1 - SSIM) and LPIPS but for windows
    that straddle the border. Other measures of two pictures are n/a.
    """
    found = dict(scores)
    for name, value in ((name, each.value) for name, each in scores.items() if each.value is not None):
        if name.startswith("psnr"):
            found[name] = Value(value if value >= PSNR_CAP else value + 10 * math.log10(share))
        elif name == "ssim":
            found[name] = Value(1 - (1 - value) / share)
        elif name.startswith("lpips"):
            found[name] = Value(value / share)
        else:
            reason = "pixels of this view are left out, and what this measure is without them is not known"
            found[name] = Value(None, reason)
    return found


def mean_roughness(view: View, maps: Maps) -> float | None:
    """Mean of the recovered roughness where the view is covered by more than half; None without the map or a mask.

    Raises NumericalFailure where it is not finite there.
    """
    inside = coverage(view)[..., 0] > 0.5
    if "roughness" not in maps or not inside.any():
        return None
    mean = float(maps["roughness"][inside].double().mean())
    if not math.isfinite(mean):
        raise NumericalFailure(
            f"a rendered map 'roughness' is not finite where view '{view.name}' shows the object",
            "Its mean is part of the result.",
        )
    return mean


def against_reference(image: Image, reference: Image, mask: Float[Tensor, "height width 1"]) -> dict[str, Value]:
    """``bias`` and ``psnr_reference`` of a relit image, display sRGB on black, against the same view of the reference.

    Both show one model under one light, and differ in the estimator of light transport. ``bias``: by how many percent
    the mean linear radiance, times the true coverage, exceeds the reference's; clipped pixels count as shown.
    ``psnr_reference``: PSNR of the display images times the true coverage.
    """
    radiance, expected = (float((srgb_decode(each) * mask).sum()) for each in (image, reference))
    bias = Value(100 * (radiance / expected - 1)) if expected > 0 else Value(None, "the reference is black")
    return {"bias": bias, "psnr_reference": Value(psnr(image * mask, reference * mask))}


def without_reference(reason: str) -> dict[str, Value]:
    """The measures of ``against_reference``, all n/a with the given reason."""
    return dict.fromkeys(("bias", "psnr_reference"), Value(None, reason))


def score_constant_roughness(scores: MetricsByView, scene: Scene) -> None:
    """Score the best constant: ``roughness/constant``. A recovered roughness with its error carries no information.

    The best constant has the least error, summed over the test views. Nothing is scored if a view lacks true roughness.
    """
    views = [view for view in scene.test if view.has("roughness")]
    if not views or len(views) < len(scene.test):
        return

    def error(view: View, constant: float) -> Value:
        mask = coverage(view)
        return scores.rules.score_roughness(constant * mask, truth(view, "roughness"), mask)["mse"]

    # The summed error is a parabola in the constant: three of its values give its lowest point.
    found = [[error(view, constant).value for view in views] for constant in (0.0, 0.5, 1.0)]
    zero, half, one = (math.fsum(each for each in of_views if each is not None) for of_views in found)
    curvature = zero - 2 * half + one
    known = curvature > 0 and not any(each is None for of_views in found for each in of_views)
    for view in views:
        best = 0.5 - (one - zero) / (4 * curvature) if known else None
        value = Value(None, "no view shows a roughness") if best is None else error(view, best)
        scores.add("roughness", view.name, {"constant": value})


def score_albedo(scores: MetricsByView, scene: Scene, rendered: Mapping[str, Maps]) -> Float[Tensor, "3"] | None:
    """Align the recovered albedo over all test views with true albedo, and score it; returns the factor per channel."""
    views = [view for view in scene.test if view.has("albedo") and "albedo" in rendered[view.name]]
    if not views or scene.surrounded:
        return None
    rules = scores.rules
    truths, masks = [truth(view, "albedo") for view in views], [coverage(view) for view in views]
    predictions = [rendered[view.name]["albedo"] for view in views]
    alphas = [rendered[view.name].get("alpha", mask) for view, mask in zip(views, masks, strict=True)]
    scale = rules.albedo_scale(predictions, truths, masks, alphas)
    for view, prediction, target, mask, alpha in zip(views, predictions, truths, masks, alphas, strict=True):
        scores.add("albedo", view.name, rules.score_albedo(prediction, target, scale, mask, alpha))
    return scale


def score_depth(scores: MetricsByView, scene: Scene, rendered: Mapping[str, Maps]) -> None:
    """Score depth over all test views with true depth, if the protocol compares depth."""
    views = [view for view in scene.test if view.has("depth") and "depth" in rendered[view.name]]
    if scores.rules.depth is None or not views:
        return
    depths, targets = [rendered[view.name]["depth"] for view in views], [truth(view, "depth") for view in views]
    errors = scores.rules.score_depth(depths, targets, [coverage(view) for view in views])
    for view, error in zip(views, errors, strict=True):
        scores.add("depth", view.name, error)


def lit_views(scene: Scene, views: Sequence[View]) -> dict[str, list[View]]:
    """For each light of the scene, the views that have a relit ground-truth image under it."""
    lit = {light: [view for view in views if view.has(f"relit/{light}")] for light in scene.lights}
    return {light: views for light, views in lit.items() if views}


def compared_indirect(rules: Protocol) -> str:
    """Name of the rendered map that a protocol compares with the scene's indirect light."""
    incident = rules.indirect is not None and rules.indirect.quantity == "incident"
    return "incident" if incident else "indirect"


def coverage(view: View) -> Float[Tensor, "height width 1"]:
    """The true coverage [height, width, 1]: 1 without an alpha map, and 0 at excluded pixels."""
    alpha = view.read("alpha") if view.has("alpha") else torch.ones(view.camera.height, view.camera.width, 1)
    return alpha * view.read("valid") if view.has("valid") else alpha


def truth(view: View, name: str) -> Image:
    """A ground-truth map on black; ``relit/<light>/indirect`` is stored as ``indirect`` is."""
    image = view.read(name)
    multiplied = name in MULTIPLIED or (name.startswith("relit/") and name.endswith("/indirect"))
    return image if multiplied else image * coverage(view)


def displayed(linear: Image) -> Image:
    """Linear radiance as display sRGB in [0, 1]."""
    return srgb_encode(linear).clamp(0, 1)
