"""Measured memory of each phase of a run, beside the formula's.

    python -m bench.memory SPACING [SIDE]

Surfels lie SPACING apart (a share of the extent) over the surfaces of ``corner``; images have SIDE x SIDE pixels (800),
the budget is preset ``paper``. One thread; it takes minutes at 100,000 surfels and hours at a million.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import torch

from allocations import Allocated, allocations
from radiogs.initialise import Initialisation
from radiogs.method import inverse_rendering
from radiogs.model import Model
from radiogs.rehearsing import memory_of, short_run
from radiogs.relighting import RelitBySurfels, fine_tuned, relight
from radiogs.settings import PRESETS, Budget, Variant
from radiogs_core.capabilities import TrainingImages
from radiogs_core.contract import Run
from radiogs_core.instruments import recording
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.learning.geometry import GeometryLearning
from radiogs_core.learning.losses import edge_weights
from radiogs_core.learning.radiance_solver import RenderingEquation
from radiogs_core.on_surfels.stage import SurfelStage
from radiogs_core.plain_values import with_values
from radiogs_core.surfels.known_surfaces import surfels_on
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport import light_filters, splitsum
from radiogs_core.transport.tracer import SurfelTracer, gather_incident
from radiogs_datasets.enlargement import enlarged
from radiogs_datasets.registry import load_scene

CPU = torch.device("cpu")
GIB = 2**30
NEVER = 10**6
VIEWS, SIDE = 4, 800

FIRST_STEPS, REFRESH = 2, 4


def copied(value: Any) -> Any:
    """A state that shares nothing with the stage it is from."""
    if isinstance(value, Mapping):
        return {name: copied(each) for name, each in value.items()}
    return value.clone() if isinstance(value, torch.Tensor) else value


def surfels_over(spacing: float) -> Surfels:
    """Surfels over the surfaces of ``corner``, as those of a trained model lie; ``spacing`` in shares of its extent."""
    scene = load_scene("corner")
    true = surfels_on(scene.true_surfaces(spacing * scene.extent)).parameters()
    return Surfels.of({name: value.float() for name, value in true.items()})


def warm_up(*heights: int) -> None:
    """Make the tables that a process keeps: they are counted apart."""
    splitsum.brdf_table()
    for height in heights:
        matrices(height)


def matrices(height: int) -> int:
    """Bytes of those that filter a light of so many rows, and its gradient."""
    light = torch.ones(min(height, splitsum.LARGEST_HEIGHT), 2 * min(height, splitsum.LARGEST_HEIGHT), 3)
    light_filters.filtered_light(light.requires_grad_(), 1 + len(light_filters.LEVELS)).sum().backward()
    return 2 * light_filters.filters_bytes(len(light))


def prepare(stage: SurfelStage[Any, Any]) -> None:
    """Compute what steps keep of every view."""
    for view in stage.views:
        step = view.decoded()
        for background in (0.0, 1.0):
            step.over(background)
        edge_weights(step, GeometryLearning().edge_sharpness, across_silhouettes=False)


def hits_a_ray(surfels: Surfels) -> float:
    with recording() as found:
        gather_incident(SurfelTracer(surfels), surfels, 4, None)
    return found.work["hits"] / found.work["rays"]


@dataclass(frozen=True)
class Measured:
    """hits: surfels that a ray meets, on average. phases: by their titles in the formula."""

    surfels: int
    hits: float
    phases: Mapping[str, Allocated]


def measured(spacing: float, budget: Budget, side: int) -> Measured:
    """Every phase of a run, each under a ledger that has seen all that it holds but for ``tables``."""
    use_threads(1)
    surfels = surfels_over(spacing)
    scene = enlarged(load_scene("corner"), VIEWS, 1, side, side)
    light = next(iter(scene.lights.values()))
    short = short_run(Variant(), budget, len(surfels))
    variant, whole = short.variant, with_values(short.budget, {"geometry.densify_interval": NEVER})
    warm_up(budget.light_height, light.radiance.shape[0])
    found: dict[str, Allocated] = {}
    with allocations() as ledger:
        stage = Initialisation(Run(scene, variant, whole, 0, CPU))
        stage.optimiser.replace(surfels, torch.full((len(surfels),), -1))
        prepare(stage)
        for _ in range(FIRST_STEPS):
            stage.step()
        ledger.phase("stage 1, a step", stage.step)
    found |= ledger.phases
    state = copied(stage.state())
    del stage
    with allocations() as ledger:
        inverse = inverse_rendering(Run(scene, variant, whole, 0, CPU), copied(state))
        prepare(inverse)
        for _ in range(FIRST_STEPS):
            inverse.step()
        ledger.phase("stage 2, a step", inverse.step)
        while inverse.iteration < REFRESH:
            inverse.step()
        ledger.phase("stage 2, all light anew", inverse.step)
    found |= ledger.phases
    tensors = inverse.product()
    del inverse, state
    by_rays = Run(scene, replace(variant, relighting="pbr"), whole, 0, CPU, None)
    with allocations() as ledger:
        shown = [Model.of(copied(tensors))]
        preparing = partial(relight, shown[0], light, torch.ones(3), by_rays)
        shown = [ledger.phase("relighting, preparing by rays", preparing)]
        del preparing
        ledger.phase("relighting, a frame by rays", partial(shown[0].render, scene.test[0].camera))
    found |= ledger.phases
    del shown
    bounced = replace(by_rays, variant=replace(variant, relighting="bounces"))
    with allocations() as ledger:
        preparing = partial(relight, Model.of(copied(tensors)), light, torch.ones(3), bounced)
        ledger.phase("relighting, preparing by traced bounces", preparing)
        del preparing
    found |= ledger.phases
    with allocations() as ledger:
        alone = RelitBySurfels(Model.of(copied(tensors)).surfels)
        ledger.phase("relighting, a frame by surfels alone", partial(alone.render, scene.test[0].camera))
    found |= ledger.phases
    del alone
    tuned = replace(by_rays, budget=replace(whole, finetune_iterations=1))
    with allocations() as ledger:
        again = Model.of(copied(tensors)).surfels
        equation = RenderingEquation(light, again.albedo.detach())
        tuning = partial(fine_tuned, again, equation, tuned, lambda: None)
        ledger.phase("relighting, a step of fine-tuning", tuning)
    found |= ledger.phases
    return Measured(len(again), hits_a_ray(again), found)


def tables(title: str, budget: Budget) -> int:
    """Bytes of the tables that were made before, in the phases that the formula counts them in."""
    if title.endswith(("fine-tuning", "alone", "bounces")):
        return 0
    if title.startswith("stage"):
        return matrices(budget.light_height)
    return light_filters.filters_bytes(splitsum.LARGEST_HEIGHT)


def table(found: Measured, side: int) -> list[str]:
    """Lines of Markdown."""
    plan = memory_of(Variant(), PRESETS["paper"], found.surfels, TrainingImages(VIEWS, side, side), found.hits)
    lines = [
        f"{found.surfels:,} surfels, {found.hits:.1f} hits a ray, {VIEWS} views of {side} x {side}, preset paper",
        "",
        "| phase | held, GiB | by formula | peak, GiB | by formula |",
        "|---|---:|---:|---:|---:|",
    ]
    for phase in plan:
        own, made_before = found.phases[phase.title], tables(phase.title, PRESETS["paper"])
        values = own.held + made_before, phase.held, own.peak + made_before, phase.peak
        lines.append(f"| {phase.title} | " + " | ".join(f"{value / GIB:.3f}" for value in values) + " |")
    return lines


def main(arguments: list[str]) -> None:
    """Print the table."""
    side = int(arguments[1]) if len(arguments) > 1 else SIDE
    found = measured(float(arguments[0]), PRESETS["paper"], side)
    sys.stdout.write("\n".join(table(found, side)) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
