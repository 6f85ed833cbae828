"""Scoring a trained model: its maps of the test views, the views under other lights, and the light it found."""

import math
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from radiogs.model import Model
from radiogs.relighting import Relit, relit_under, training_share
from radiogs.rendering import Renderer
from radiogs_core.contract import Run
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.splatting import splat

from ..experiments.train import Evaluation
from ..metrics import Value, protocol
from ..suites.cell import Cell
from .figures import Figures
from .frame_cost import Costs
from .light_maps import light_maps
from .scoring import (
    Image,
    Maps,
    compared_indirect,
    coverage,
    lit_views,
    score_albedo,
    score_depth,
    score_light,
    score_view,
    truth,
)  # fmt: skip

SHOWN = ("image", "albedo", "normal", "roughness", "indirect")
"""Maps of the shown view that are kept beside the result."""


STRIP = 4
"""Relit maps of the shown view are kept under this many lights, the first ones."""


def evaluate(
    model: Model,
    scene: Scene,
    cell: Cell,
    device: torch.device,
    advance: Callable[[int, int], None],
    timed: bool = True,
) -> Evaluation:
    """Score a model on every test view, and under every light that test views, or views elsewhere, are given under.

    ``advance`` is told (done, total) images, after every one and after every step of fine-tuning; it may raise to stop.
    The arrays are ``render/<map>`` and ``truth/<map>`` of the middle test
    view, on black, [height, width, channels], float32: image, albedo (linear, aligned), normal, roughness, indirect
    (linear), and relit (under the first light, and ``relit/<light>`` under the first few); those that the scene has no
    truth for are left out under ``truth/``. ``render/incident`` is the indirect light that arrives (see
    ``incident_map``). Beside them lie ``render/environment`` and ``truth/environment`` (see ``light_maps``) where the
    light is known. ``timed`` is whether frames are timed. Raises DataError for a damaged map.
    """
    rules = protocol(cell.protocol)
    figures = Figures(rules, [view.name for view in scene.test], [view.name for view in scene.relight])
    shown = scene.test[len(scene.test) // 2]
    lit = lit_views(scene, (*scene.test, *scene.relight))
    shown_light = next((light for light, views in lit.items() if shown in views), None)
    total = len(scene.test) + sum(map(len, lit.values()))
    arrays = {f"truth/{name}": truth(shown, name) for name in SHOWN if shown.has(name)}

    renderer = Renderer(model, cell.budget.incident_samples, cell.variant)
    kept_maps = ("albedo", "alpha") if rules.depth is None else ("albedo", "alpha", "depth")
    kept: dict[str, Maps] = {}
    for done, view in enumerate(scene.test, start=1):
        camera = view.camera.to(device, torch.float32)
        maps = on_cpu(renderer.render(camera))
        if renderer.incident is not None and (view is shown or compared_indirect(rules) == "incident"):
            maps["incident"] = incident_map(model, renderer.incident, camera).cpu()
        score_view(figures, view, maps)
        kept[view.name] = {name: maps[name] for name in kept_maps}
        if view is shown:
            arrays |= {f"render/{name}": maps[name] for name in (*SHOWN, "incident") if name in maps}
        advance(done, total)

    costs = Costs(Figures(rules, *figures.groups), device)
    if timed:
        costs.measure("nvs", renderer.render, scene.test)
    del renderer  # its rays are not to count as memory of what follows
    found = EnvironmentMap(model.environment.detach().cpu())
    score_light(figures, scene, found)
    if scene.training_light is not None:
        arrays |= light_maps(found, scene.training_light)
    score_depth(figures, scene, kept)
    scale = score_albedo(figures, scene, kept)
    arrays["render/albedo"] = kept[shown.name]["albedo"] * (torch.ones(3) if scale is None else scale)
    applied = torch.ones(3) if scale is None else rules.relighting_scale(scale)
    done = len(scene.test)
    prepared: list[float] = []

    def still_there() -> None:
        advance(done, total)

    for light, relit, seconds in relit_models(model, scene, list(lit), applied, cell, device, still_there):
        prepared.append(1e3 * seconds)
        if timed:
            costs.measure("render", relit.render, lit[light])
        for view in lit[light]:
            done += 1
            maps = on_cpu(relit.render(view.camera.to(device, torch.float32)))
            image, target, mask = maps["image"], truth(view, f"relit/{light}"), coverage(view)
            figures.add("relight", view.name, rules.score_image(image, target, mask, maps["alpha"], "relight"))
            if view is shown and light == shown_light:
                arrays |= {"render/relit": image, "truth/relit": target}
            if view is shown and list(lit).index(light) < STRIP:
                arrays |= {f"render/relit/{light}": image, f"truth/relit/{light}": target}
            advance(done, total)
    if timed and prepared:
        costs.figures.add_whole("prepare", {"ms": Value(math.fsum(prepared) / len(prepared))})

    return Evaluation(
        metrics=figures.metrics(),
        timings=costs.timings(),
        views=list(figures.views),
        shown_view=shown.name,
        shown_light=shown_light,
        albedo_scale=None if scale is None else scale.tolist(),
        arrays={name: image.numpy().astype(np.float32) for name, image in arrays.items()},
        protocol=rules.describe(),
    )


def relit_models(
    model: Model,
    scene: Scene,
    lights: Sequence[str],
    albedo_scale: Float[Tensor, "3"],
    cell: Cell,
    device: torch.device,
    after_step: Callable[[], None],
) -> Iterator[tuple[str, Relit, float]]:
    """The model under each light, in the mode of the cell's variant, and the seconds that it took to be made ready.

    ``after_step`` is called after each step of fine-tuning.
    """
    run = Run(scene, cell.variant, cell.budget, cell.seed, device)
    share = training_share(scene, model.surfels) if cell.variant.effects == "auto" else None
    for light in lights:
        started = time.perf_counter()
        relit = relit_under(model, scene.lights[light], albedo_scale, run, after_step, share)
        if device.type == "cuda":
            torch.cuda.synchronize(device)
        yield light, relit, time.perf_counter() - started


@torch.no_grad()
def incident_map(model: Model, incident: Incident, camera: Camera) -> Float[Tensor, "height width 3"]:
    """Mean over each surfel's hemisphere of the indirect radiance that arrives, linear, splatted on black.

    What the released RadioGS code writes as ``light_indirect``: no cosine, no albedo.
    """
    weight = incident.weight[..., None]
    arriving = (weight * incident.radiance).sum(1) / weight.sum(1)
    return splat(camera, model.surfels, {"incident": arriving}, depth_unit=1.0).images["incident"]


def on_cpu(maps: Maps) -> dict[str, Image]:
    """The maps in main memory, where they are scored."""
    return {name: image.cpu() for name, image in maps.items()}
