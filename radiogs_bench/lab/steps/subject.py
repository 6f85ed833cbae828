"""The subject of a measurement: a method on a scene of stated size, with surfels on surfaces as after training."""

import math
from dataclasses import dataclass, replace
from typing import Any

import torch

from radiogs_core.capabilities import Rehearsing, ShortRun
from radiogs_core.contract import Method, Stage
from radiogs_core.errors import UsageError
from radiogs_core.on_surfels.fit_geometry import FitGeometry
from radiogs_core.plain_values import leaf_names, with_values
from radiogs_core.scene.scene import Scene
from radiogs_core.surfels.known_surfaces import OVERLAP as OVERLAP_OF_KNOWN
from radiogs_core.surfels.known_surfaces import surfels_on
from radiogs_core.surfels.surfels import Surfels
from radiogs_datasets.enlargement import enlarged

from ..kernels.scenes import OVERLAP, SPREAD
from ..rehearsal.plan import RehearsedRow
from .sizes import OWN_SIZES, WARM_UP, Size, can_be_sized, largest_model, surfel_fields

FIRST_SPACING = 0.05
"""Distance between surfels, in scene extents, from which the wanted number is approached."""

SPARE = 1.05
"""Least ratio of laid to wanted surfels: surplus surfels are drawn away at random to get the exact number, and the
remaining ones widened to fill the gaps."""

TEST_VIEWS = 4

ON_SURFACES, OWN_START = "on the true surfaces", "as the method starts"


@dataclass(frozen=True)
class Subject:
    """A method, the short run that is measured, and the scene."""

    method: Method
    size: Size
    surfels: int | None
    """Surfels of the model; None: the method decides."""
    scene: Scene
    short: ShortRun
    device: torch.device


def subject_of(method: Method, scene: Scene, size: Size, device: torch.device) -> Subject:
    """The method on the scene, enlarged to a size. Raises UsageError as ``require_size`` does."""
    require_size(method, size)
    budget = sized_budget(method, size)
    wanted = largest_model(method, budget) if size.surfels is None else size.surfels
    if not can_be_sized(method, budget):
        wanted = None
    elif not isinstance(method, Rehearsing):
        budget = with_values(budget, dict.fromkeys(surfel_fields(budget), wanted), f"budget of {method.name}")
    row = RehearsedRow("steps", method, method.name, method.variant(), budget)
    large = enlarged(scene, size.views, TEST_VIEWS, size.side, size.side)
    return Subject(method, size, wanted, large, row.short(wanted if isinstance(method, Rehearsing) else None), device)


def sized_budget(method: Method, size: Size) -> Any:
    """The preset's budget, with the size's own numbers if the method has them."""
    budget = method.presets[size.preset]
    own = {name: value for name, value in size.values.items() if name in leaf_names(budget)}
    return with_values(budget, own, f"budget of {method.name}")


def require_size(method: Method, size: Size) -> None:
    """Raise UsageError for a method without the size's preset, or that cannot be given its number of surfels."""
    if size.preset not in method.presets:
        raise UsageError(
            f"{method.name} has no preset '{size.preset}'",
            f"Size {size.name} takes its samples from it; there are: {', '.join(method.presets)}.",
            "Choose other sizes:  --sizes",
        )
    if size.surfels is not None and size != WARM_UP and not can_be_sized(method, method.presets[size.preset]):
        raise UsageError(
            f"size {size.name} has {size.surfels:,} surfels, which {method.name} cannot be given",
            "Its budget has no number of a model's surfels, and another size would be measured.",
            f"Choose sizes that are a preset's own:  --sizes {','.join(OWN_SIZES)}",
        )


def lay_on_surfaces(stage: Stage, subject: Subject) -> str:
    """Replace the surfels that a stage begins with by surfels on the scene's true surfaces; returns which were used.

    In a visual hull a ray meets ten times the surfels that it meets in a trained model, and small images have points on
    swept surfaces for fewer surfels than are asked for.
    """
    if not isinstance(stage, FitGeometry) or subject.scene.surfaces is None:
        return OWN_START
    count = len(stage.surfels) if subject.surfels is None else subject.surfels
    laid = surfels_over(subject.scene, count)
    made = Surfels.of({name: value.to(subject.device) for name, value in laid.parameters().items()})
    stage.optimiser.replace(made, torch.full((count,), -1, device=subject.device))
    return ON_SURFACES


def surfels_over(scene: Scene, count: int) -> Surfels:
    """So many surfels on the true surfaces, as wide and opaque as kernel scene M's, with noisy radiance."""
    spacing = FIRST_SPACING * scene.extent
    samples = scene.true_surfaces(spacing)
    while len(samples) < count:
        spacing *= min(0.9, math.sqrt(len(samples) / (SPARE * count)))
        samples = scene.true_surfaces(spacing)
    generator = torch.Generator().manual_seed(0)
    kept = torch.randperm(len(samples), generator=generator)[:count].sort().values
    surfels = surfels_on(samples).take(kept)
    wider = OVERLAP / OVERLAP_OF_KNOWN * math.sqrt(len(samples) / count)
    noise = torch.randn(count, 2, generator=generator)
    opacity = 0.5 + 0.49 * torch.rand(count, generator=generator)
    return replace(
        surfels,
        log_scale=surfels.log_scale + math.log(wider) + SPREAD * noise,
        opacity_logit=torch.logit(opacity),
        sh=0.1 * torch.randn(surfels.sh.shape, generator=generator),
    )
