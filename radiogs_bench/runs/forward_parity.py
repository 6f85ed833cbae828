"""Compares light transport through surfels with a path tracer: is the fixed point of L_rad global illumination?

Surfels are placed on the scene's true surfaces with their true materials, under the true light. Their radiance is
solved for by minimising L_rad alone and compared with the path tracer's. Nothing is learnt from images.
"""

import math
import time
from collections.abc import Mapping
from functools import partial

import numpy as np
import torch
from jaxtyping import Bool
from torch import Tensor
from torch.nn.functional import max_pool2d

from radiogs_core.instruments import recording
from radiogs_core.learning.known_scene import OFFSET, KnownScene, known_scene
from radiogs_core.learning.radiance_solver import RadianceSolver, RenderingEquation, SolverBudget
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.scene import Scene, View
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.sampling import relighting_directions
from radiogs_core.transport.splatting import (
    DIFFUSE_DIRECT,
    DIFFUSE_INDIRECT,
    SOLID_ALPHA,
    SPECULAR_DIRECT,
    SPECULAR_INDIRECT,
    shade_surfels,
    splat,
    towards,
)
from radiogs_core.transport.tracer import SurfelTracer, incident_along

from ..scoring.metrics.protocols import protocol
from ..scoring.metrics.values import PSNR_CAP, Value
from ..scoring.metrics_by_view import MetricsByView
from ..scoring.score_maps import Image, coverage, displayed, truth
from ..store.provenance import reset_peaks, session
from .cell import Cell
from .result import EVALUATE, add_stage, empty_result
from .stages import Bench
from .training_curves import Trail
from .unchanged_scene import require_unchanged

SPACING = 0.03
"""World units between surfels; the scenes are 2 to 3 across."""

SPREAD_SAMPLES, LIGHT_SAMPLES = 192, 192
"""Directions for shading images: over the hemisphere, and drawn from the light. Without the latter, the same few
directions would represent the sun at every surfel of a face."""

MARGIN = 3
"""Distance to silhouettes in pixels below which pixels are not compared: surfels blur edges by about their spacing."""

SILHOUETTE = 5e-3
"""Change of slope of the inverse depth, per world unit, above which two pixels see different surfaces. Inverse depth is
linear over a plane; an edge between two faces at 4 units bends it by at most 3e-3, a step of 0.1 units by 6e-3."""

PARTS = ("total", "surfels", "direct", "indirect")
"""Compared quantities: shaded radiance, the surfels' own radiance, and the direct and indirect parts of the former."""


SOLVE, SOLVING = "solve", "solving for the radiance"
"""Name of the single stage in results, and its title on progress bars."""


def run_forward_parity(bench: Bench, cell: Cell, scene: Scene) -> None:
    """Solve for the radiance, compare it on every test view, store the result."""
    made = known_scene(scene, cell.settings.get("spacing", SPACING)).to(bench.device)
    reset_peaks(bench.device)
    started = time.perf_counter()
    with recording() as solving:
        solver, trail, losses = solved(bench, cell, scene, made)
    ended = time.perf_counter()
    with recording() as evaluating:
        values, arrays = compared_views(bench, cell, scene, made, solver)
    result = empty_result(cell, values.rules.describe())
    result["metrics"] = values.metrics()
    result["views"] = list(values.views)
    result["shown_view"] = scene.test[0].name
    result["facts"] = {"surfels": len(made.surfels)}
    result["stages"] = [{"name": SOLVE, "title": SOLVING}]
    result["losses"] = {SOLVE: losses}
    result["trail"] = {SOLVE: trail.points}
    here = [session(bench.device)]
    add_stage(result, SOLVE, solving, ended - started, here)
    add_stage(result, EVALUATE, evaluating, time.perf_counter() - ended, here)
    require_unchanged(scene, bench.digest)
    bench.store.put_result(result, arrays)


def solved(bench: Bench, cell: Cell, scene: Scene, made: KnownScene) -> tuple[RadianceSolver, Trail, dict[str, float]]:
    """The finished solver, the trail of its losses, and the last losses."""
    started = time.perf_counter()
    cameras, offset = [view.camera for view in scene.train], cell.settings.get("offset", OFFSET)
    cost = cell.budget  # the effort is that of RadioGS's fine-tuning for a new light
    effort = SolverBudget(cost.finetune_iterations, cost.finetune_surfels, cost.finetune_samples)
    tracer = partial(SurfelTracer, offset=offset)
    solver = RadianceSolver(made.surfels, made.equation, cameras, effort, cell.seed, tracer)
    trail, losses = Trail(solver.iterations, [], {}, scored=False), dict[str, float]()
    while solver.iteration < solver.iterations:
        losses = dict(solver.step())
        trail.add(losses)
        if trail.due(solver.iteration):
            trail.close(solver.iteration, time.perf_counter() - started, {})
        bench.progress.advance(SOLVING, solver.iteration, solver.iterations)
        bench.interruption.check()
    return solver, trail, losses


def compared_views(
    bench: Bench, cell: Cell, scene: Scene, made: KnownScene, solver: RadianceSolver
) -> tuple[MetricsByView, dict[str, np.ndarray]]:
    """Metrics of every test view, and the maps of the first one."""
    values = MetricsByView(protocol(cell.protocol), [view.name for view in scene.test])
    incident = shading_incident(solver)
    arrays: dict[str, np.ndarray] = {}
    for view in scene.test:
        ours = transported(solver.surfels, made.equation, incident, view.camera.to(bench.device, torch.float32))
        true = traced(view)
        for name, scores in compared(ours, true, clear_of_silhouettes(view)).items():
            values.add(name, view.name, scores)
        if view is scene.test[0]:
            for origin, maps in (("render", ours), ("truth", true)):
                shown = {"image": displayed(maps["total"]), "indirect": maps["indirect"]}
                arrays |= {f"{origin}/{name}": image.numpy() for name, image in shown.items()}
    return values, arrays


@torch.no_grad()
def shading_incident(stage: RadianceSolver) -> Incident:
    """Incident light of all surfels after their radiance is solved for."""
    normal = stage.surfels.frame[..., 2]
    directions = relighting_directions(normal, stage.sampler, SPREAD_SAMPLES, LIGHT_SAMPLES, stage.generator)
    return incident_along(stage.tracer, *directions)


@torch.no_grad()
def transported(surfels: Surfels, equation: RenderingEquation, incident: Incident, camera: Camera) -> dict[str, Image]:
    """Linear radiance of one view, by ``PARTS``, on black; emission counts as direct."""
    outgoing = towards(camera, surfels)
    parts = shade_surfels(surfels, equation.albedo, incident, outgoing[:, None], equation.light.radiance)[:, 0]
    counted = [part for part in (DIFFUSE_DIRECT, SPECULAR_DIRECT) if part in equation.parts]
    direct = parts[:, counted].sum(1)
    if equation.emission is not None:
        direct = direct + equation.emission
    indirect = parts[:, [part for part in (DIFFUSE_INDIRECT, SPECULAR_INDIRECT) if part in equation.parts]].sum(1)
    channels = {
        "total": direct + indirect,
        "surfels": surfel_radiance(surfels.sh, outgoing),
        "direct": direct,
        "indirect": indirect,
    }
    seen = splat(camera, surfels, channels, depth_unit=1.0)
    # Whole, as the tracer makes what a ray meets: a few per cent of a solid surface are gaps between Gaussians.
    whole = torch.where(seen.alpha > SOLID_ALPHA, seen.alpha, 1.0)[..., None]
    return {name: (image / whole).cpu() for name, image in seen.images.items()}


def traced(view: View) -> dict[str, Image]:
    """The path tracer's radiance of one view, by ``PARTS``. Raises DataError if the scene lacks a part."""
    direct, indirect = truth(view, "direct"), truth(view, "indirect")
    total = direct + indirect
    return {"total": total, "surfels": total, "direct": direct, "indirect": indirect}


def compared(
    ours: Mapping[str, Image], true: Mapping[str, Image], kept: Bool[Tensor, "height width"]
) -> dict[str, dict[str, Value]]:
    """By part: PSNR in display colour and bias of the energy in percent, over the compared pixels."""
    found = {}
    for name in PARTS:
        mine, yours = ours[name][kept], true[name][kept]
        error = float((displayed(ours[name]) - displayed(true[name]))[kept].double().square().mean())
        energy = float(yours.double().sum())
        bias = (
            Value(100 * (float(mine.double().sum()) / energy - 1)) if energy > 0 else Value(None, "the scene is dark")
        )
        found[name] = {"psnr": Value(min(PSNR_CAP, -10 * math.log10(max(error, 1e-30)))), "bias": bias}
    return found


def clear_of_silhouettes(view: View) -> Bool[Tensor, "height width"]:
    """Pixels at least MARGIN away from partly covered pixels and from edges between surfaces."""
    depth = view.read("depth")[..., 0]
    whole = (coverage(view)[..., 0] > 1 - 1e-3) & (depth > 0)
    inverse = torch.where(whole, 1 / torch.where(whole, depth, 1.0), 0.0)
    bend = torch.zeros_like(inverse)
    bend[1:-1] = (inverse[2:] - 2 * inverse[1:-1] + inverse[:-2]).abs()
    bend[:, 1:-1] = bend[:, 1:-1].maximum((inverse[:, 2:] - 2 * inverse[:, 1:-1] + inverse[:, :-2]).abs())
    unclear = (~whole | (bend > SILHOUETTE)).to(inverse.dtype)
    # Outside the picture counts as covered: the border hides no silhouette.
    return max_pool2d(unclear[None, None], 2 * MARGIN + 1, stride=1, padding=MARGIN)[0, 0] == 0
