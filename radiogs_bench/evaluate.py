"""Scoring a trained model: its maps of the test views, and the views under other lights.

Every map is compared as it is composited on black: the ground truth's straight maps are multiplied by its coverage,
the rendered ones are multiplied by theirs. Linear radiance (``indirect``) is compared as display sRGB, clipped; albedo
as it is, linear, after alignment and clipped to [0, 1].
"""

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from radiogs.colour import srgb_encode
from radiogs.model import Model
from radiogs.relighting import Relit
from radiogs.rendering import Renderer
from radiogs.scene import Scene, View

from .cell import Cell
from .figures import Figures
from .metrics import protocol
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
    albedo: dict[str, Image] = {}
    for done, view in enumerate(scene.test, start=1):
        maps = on_cpu(renderer.render(view.camera.to(device, torch.float32)))
        score_view(figures, view, maps)
        albedo[view.name] = maps["albedo"]
        if view is shown:
            arrays |= {f"render/{name}": maps[name] for name in SHOWN}
        advance(done, total)

    scale = score_albedo(figures, scene, albedo)
    applied = torch.ones(3) if scale is None else scale
    arrays["render/albedo"] = albedo[shown.name] * applied
    relit = relit_views(model, lit, scene, applied, cell, device)
    for done, (light, view, image) in enumerate(relit, start=len(scene.test) + 1):
        target = truth(view, f"relit/{light}")
        figures.add("relight", view.name, rules.score_image(image, target))
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
    rules, mask = figures.rules, coverage(view)
    figures.add("nvs", view.name, rules.score_image(maps["image"], truth(view, "image")))
    if view.has("normal"):
        error = rules.normal_mae(maps["normal"], truth(view, "normal"), mask)
        figures.add("normal", view.name, {"mae": error})
    if view.has("roughness"):
        error = rules.roughness_mse(maps["roughness"], truth(view, "roughness"), mask)
        figures.add("roughness", view.name, {"mse": error})
    if view.has("indirect"):
        scores = rules.score_image(displayed(maps["indirect"]), displayed(truth(view, "indirect")))
        figures.add("indirect", view.name, scores)


def score_albedo(figures: Figures, scene: Scene, rendered: Mapping[str, Image]) -> Float[Tensor, "3"] | None:
    """Align the recovered albedo over all test views that have a true one, score it, and return the factor."""
    views = [view for view in scene.test if view.has("albedo")]
    if not views:
        return None
    truths = [truth(view, "albedo") for view in views]
    predictions = [rendered[view.name] for view in views]
    scale = figures.rules.albedo_scale(predictions, truths, [coverage(view) for view in views])
    for view, prediction, target in zip(views, predictions, truths, strict=True):
        figures.add("albedo", view.name, figures.rules.score_image((prediction * scale).clamp(0, 1), target))
    return scale


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
) -> Iterator[tuple[str, View, Image]]:
    """Light, view and display image of the model under every light, light by light."""
    for light, views in lit.items():
        relit = Relit(model, scene.lights[light], albedo_scale, cell.budget, cell.seed)
        for view in views:
            yield light, view, relit.render(view.camera.to(device, torch.float32))["image"].cpu()


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
