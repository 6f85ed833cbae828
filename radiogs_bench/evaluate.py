"""Scoring a trained model: its maps of the test views, the views under other lights, and the light it found.

Every map goes to the protocol as it appears on black, with both coverages: the ground truth's straight maps are
multiplied by its coverage, the rendered ones are multiplied by theirs. Linear radiance (``indirect``) goes as display
sRGB, clipped; albedo as it is, linear.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from radiogs.camera import Camera
from radiogs.colour import srgb_encode
from radiogs.light import EnvironmentMap, texel_directions
from radiogs.model import Model
from radiogs.relighting import Relit
from radiogs.rendering import Renderer, splat
from radiogs.scene import Scene, View

from .cell import Cell
from .figures import Figures
from .metrics import Protocol, protocol
from .run_cell import Evaluation

Image = Float[Tensor, "height width channels"]
Maps = Mapping[str, Float[Tensor, "height width _"]]

MULTIPLIED = ("normal", "depth", "direct", "indirect")
"""Maps that a scene stores as they appear on black; the others are straight."""

SHOWN = ("image", "albedo", "normal", "roughness", "indirect")
"""Maps of the shown view that are kept beside the result."""


def evaluate(
    model: Model, scene: Scene, cell: Cell, device: torch.device, advance: Callable[[int, int], None]
) -> Evaluation:
    """Score a model on every test view, and on the test views under every light that they are given under.

    ``advance`` is told (done, total) images. The arrays are ``render/<map>`` and ``truth/<map>`` of the middle test
    view, on black, [height, width, channels], float32: image, albedo (linear, aligned), normal, roughness, indirect
    (linear), and relit (under the first light); those that the scene has no truth for are left out under ``truth/``.
    Raises DataError for a damaged map.
    """
    rules = protocol(cell.protocol)
    figures = Figures(rules, [view.name for view in scene.test])
    shown = scene.test[len(scene.test) // 2]
    lit = lit_views(scene)
    shown_light = next((light for light, views in lit.items() if shown in views), None)
    total = len(scene.test) + sum(map(len, lit.values()))
    arrays = {f"truth/{name}": truth(shown, name) for name in SHOWN if shown.has(name)}

    renderer = Renderer(model, cell.budget.incident_samples)
    kept_maps = ("albedo", "alpha") if rules.depth is None else ("albedo", "alpha", "depth")
    kept: dict[str, Maps] = {}
    for done, view in enumerate(scene.test, start=1):
        camera = view.camera.to(device, torch.float32)
        maps = on_cpu(renderer.render(camera))
        if compared_indirect(rules) == "incident":
            maps["incident"] = incident_map(renderer, camera).cpu()
        score_view(figures, view, maps)
        kept[view.name] = {name: maps[name] for name in kept_maps}
        if view is shown:
            arrays |= {f"render/{name}": maps[name] for name in SHOWN}
        advance(done, total)

    score_light(figures, scene, model)
    score_depth(figures, scene, kept)
    scale = score_albedo(figures, scene, kept)
    arrays["render/albedo"] = kept[shown.name]["albedo"] * (torch.ones(3) if scale is None else scale)
    applied = torch.ones(3) if scale is None else rules.relighting_scale(scale)
    relit = relit_views(model, lit, scene, applied, cell, device)
    for done, (light, view, maps) in enumerate(relit, start=len(scene.test) + 1):
        image, target = maps["image"], truth(view, f"relit/{light}")
        figures.add("relight", view.name, rules.score_image(image, target, coverage(view), maps["alpha"], "relight"))
        if view is shown and light == shown_light:
            arrays |= {"render/relit": image, "truth/relit": target}
        advance(done, total)

    return Evaluation(
        metrics=figures.metrics(),
        views=list(figures.views),
        shown_view=shown.name,
        shown_light=shown_light,
        albedo_scale=None if scale is None else scale.tolist(),
        arrays={name: image.numpy().astype(np.float32) for name, image in arrays.items()},
        protocol=rules.describe(),
    )


def score_view(figures: Figures, view: View, maps: Maps) -> None:
    """Score what needs no other view: novel-view synthesis, normals, roughness, indirect light."""
    rules, mask, alpha = figures.rules, coverage(view), maps["alpha"]
    figures.add("nvs", view.name, rules.score_image(maps["image"], truth(view, "image"), mask, alpha))
    if view.has("normal"):
        figures.add("normal", view.name, rules.score_normal(maps["normal"], truth(view, "normal"), mask, alpha))
    if view.has("roughness"):
        figures.add("roughness", view.name, rules.score_roughness(maps["roughness"], truth(view, "roughness"), mask))
    if view.has("indirect"):
        ours, theirs = displayed(maps[compared_indirect(rules)]), displayed(truth(view, "indirect"))
        figures.add("indirect", view.name, rules.score_image(ours, theirs, mask, alpha, "indirect"))


def score_albedo(figures: Figures, scene: Scene, rendered: Mapping[str, Maps]) -> Float[Tensor, "3"] | None:
    """Align the recovered albedo over all test views that have a true one, score it, and return the factor."""
    views = [view for view in scene.test if view.has("albedo")]
    if not views:
        return None
    rules = figures.rules
    truths, masks = [truth(view, "albedo") for view in views], [coverage(view) for view in views]
    predictions, alphas = ([rendered[view.name][name] for view in views] for name in ("albedo", "alpha"))
    scale = rules.albedo_scale(predictions, truths, masks, alphas)
    for view, prediction, target, mask, alpha in zip(views, predictions, truths, masks, alphas, strict=True):
        figures.add("albedo", view.name, rules.score_albedo(prediction, target, scale, mask, alpha))
    return scale


def score_light(figures: Figures, scene: Scene, model: Model) -> None:
    """Score the recovered environment map where the true one is known, at the true one's resolution."""
    if scene.training_light is None:
        return
    true_light = scene.training_light.radiance.cpu()
    directions = texel_directions(*true_light.shape[:2], dtype=true_light.dtype)
    found = EnvironmentMap(model.environment.detach().cpu()).lookup(directions)
    figures.add_whole("environment", figures.rules.score_environment(found, true_light))


def score_depth(figures: Figures, scene: Scene, rendered: Mapping[str, Maps]) -> None:
    """Score the depth of all test views that have a true one, if the protocol compares depth."""
    views = [view for view in scene.test if view.has("depth")]
    if figures.rules.depth is None or not views:
        return
    depths, targets = [rendered[view.name]["depth"] for view in views], [truth(view, "depth") for view in views]
    errors = figures.rules.score_depth(depths, targets, [coverage(view) for view in views])
    for view, error in zip(views, errors, strict=True):
        figures.add("depth", view.name, error)


def lit_views(scene: Scene) -> dict[str, list[View]]:
    """The test views that are given under each light."""
    lit = {light: [view for view in scene.test if view.has(f"relit/{light}")] for light in scene.lights}
    return {light: views for light, views in lit.items() if views}


def relit_views(
    model: Model,
    lit: Mapping[str, Sequence[View]],
    scene: Scene,
    albedo_scale: Float[Tensor, "3"],
    cell: Cell,
    device: torch.device,
) -> Iterator[tuple[str, View, dict[str, Image]]]:
    """Light, view and maps of the model under every light, light by light."""
    for light, views in lit.items():
        relit = Relit(model, scene.lights[light], albedo_scale, cell.budget, cell.seed)
        for view in views:
            yield light, view, on_cpu(relit.render(view.camera.to(device, torch.float32)))


def compared_indirect(rules: Protocol) -> str:
    """The rendered map that a protocol compares with the scene's indirect light."""
    incident = rules.indirect is not None and rules.indirect.quantity == "incident"
    return "incident" if incident else "indirect"


@torch.no_grad()
def incident_map(renderer: Renderer, camera: Camera) -> Float[Tensor, "height width 3"]:
    """Mean over each surfel's hemisphere of the indirect radiance that arrives, linear, splatted on black.

    What the released RadioGS code writes as ``light_indirect``: no cosine, no albedo.
    """
    weight = renderer.incident.weight[..., None]
    arriving = (weight * renderer.incident.radiance).sum(1) / weight.sum(1)
    return splat(camera, renderer.model.surfels, {"incident": arriving}, depth_unit=1.0).images["incident"]


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


def on_cpu(maps: Maps) -> dict[str, Image]:
    """The maps in main memory, where they are scored."""
    return {name: image.cpu() for name, image in maps.items()}
