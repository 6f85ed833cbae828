"""Settings of TensoIR: how much work a run does, how it learns, and what an ablation changes.

Unless a field states otherwise, defaults are the published configurations' for one light; shares are shares of stage
2's iterations.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from radiogs_core.errors import UsageError


@dataclass(frozen=True, kw_only=True)
class Budget:
    """Computational effort of a run."""

    name: str
    """Name of the preset."""
    field_iterations: int
    """Steps of stage 1, the radiance field."""
    inverse_iterations: int
    """Steps of stage 2, inverse rendering."""
    rays: int
    """Camera rays marched in each step."""
    views: int
    """Training views that the rays of a step are divided among."""
    grid_start: int
    """Nodes of the grid along an edge in stage 1."""
    grid_end: int
    """Nodes of the grid along an edge at the end of stage 2."""
    cells: int
    """Cells of the occupancy grid along an edge of the box."""
    density_components: int
    """Components of each density factor."""
    appearance_components: int
    """Components of each appearance factor."""
    features: int
    """Appearance features, the networks' input."""
    hidden: int
    """Width of the networks' hidden layers."""
    lobes: int
    """Spherical Gaussians of the light."""
    light_rows: int
    """Rows of the grid of directions from which each point is lit; it has twice as many columns."""
    secondary_samples: int
    """Samples of the field along each secondary ray."""
    relight_samples: int
    """Directions of each point in relit images, drawn from the light."""
    network_rate: float
    """Factor on the learning rates of networks and light; short runs take longer steps."""


BUDGET_SHOWN_ONLY = ("relight_samples",)
"""Fields of ``Budget`` that training does not read."""

BUDGET_INVERSE_ONLY = ("grid_end", "lobes", "light_rows", "secondary_samples", *BUDGET_SHOWN_ONLY)
"""Fields of ``Budget`` that stage 1 does not read; it reads ``inverse_iterations``: rates decay over both stages."""

NUMBERS: Mapping[str, tuple[float, float, float, float]] = {
    "field_iterations": (20, 1500, 5000, 10_000),
    "inverse_iterations": (20, 1500, 10_000, 70_000),
    "rays": (64, 256, 1024, 4096),
    "views": (4, 8, 8, 32),
    "grid_start": (12, 32, 64, 128),
    "grid_end": (16, 40, 128, 300),
    "cells": (16, 64, 96, 256),
    "density_components": (4, 8, 12, 16),
    "appearance_components": (6, 12, 24, 48),
    "features": (8, 12, 18, 27),
    "hidden": (16, 32, 64, 128),
    "lobes": (8, 32, 64, 128),
    "light_rows": (4, 4, 8, 16),
    "secondary_samples": (8, 16, 48, 96),
    "relight_samples": (8, 64, 128, 512),
    "network_rate": (3.0, 3.0, 2.0, 1.0),
}
"""Values of the fields of ``Budget`` in the presets smoke, tiny, small and paper."""

PRESETS = {
    name: Budget(name=name, **{field: values[index] for field, values in NUMBERS.items()})  # type: ignore[arg-type]
    for index, name in enumerate(("smoke", "tiny", "small", "paper"))
}


@dataclass(frozen=True)
class FieldWeights:
    """Weights of the losses of stage 1; 0 leaves one out."""

    radiance: float = 1.0
    """Weight of the mean squared error of marched pixels, display values."""
    sparsity: float = 8e-5
    """Weight of the mean absolute entry of each density plane and line, summed over the three factors."""
    density_variation: float = 0.05
    """Weight of the mean squared differences of neighbouring entries of the density planes, divided by 50."""
    appearance_variation: float = 0.005
    """Weight of the mean squared differences of neighbouring entries of the appearance planes, divided by 50."""


@dataclass(frozen=True)
class InverseWeights:
    """Weights of the losses of stage 2; 0 leaves one out."""

    radiance: float = 1.0
    """Weight of the mean squared error of marched pixels, display sRGB of linear radiance."""
    shaded: float = 0.2
    """Weight of the mean squared error of shaded pixels, display sRGB."""
    normal_difference: float = 0.002
    """Weight of the squared distance between predicted and derived normals along rays. Published: 0.0005 to 0.005,
    by scene."""
    orientation: float = 0.001
    """Weight of the squared cosine to the viewing direction of normals that face away. Published: 0.001 to 0.005,
    by scene."""
    albedo_smoothness: float = 0.001
    """Weight of the squared relative difference of albedo between samples and random nearby positions."""
    roughness_smoothness: float = 0.001
    """Weight of the squared relative difference of roughness between samples and random nearby positions."""
    sparsity: float = 4e-5
    """Weight of the mean absolute entry of each density plane and line, as in ``FieldWeights``."""


@dataclass(frozen=True)
class Rates:
    """Adam's learning rates. They decay geometrically over both stages and restart each time the grid becomes finer."""

    grid: float = 0.02
    """Rate of planes and lines."""
    network: float = 0.001
    """Rate of the networks, the basis and the light, times the budget's ``network_rate``."""
    end: float = 0.1
    """Factor on both rates after all steps of both stages."""


@dataclass(frozen=True)
class Schedule:
    """Events of stage 2, as shares of its iterations."""

    finer_at: tuple[float, ...] = (0.0, 1 / 7, 2 / 7, 3 / 7)
    """When the grid becomes finer, by the same factor each time."""
    emptied_at: tuple[float, ...] = (0.0, 1 / 14, 2 / 14, 3 / 14, 4 / 14, 5 / 14)
    """When cells without density are marked empty."""


@dataclass(frozen=True)
class LightStart:
    """Initial spherical Gaussians."""

    mean: float = 0.4
    """Mean linear radiance over all directions (published: an energy of 1.6 pi)."""
    sharpness: float = 10.0
    """Least initial sharpness."""
    spread: float = 20.0
    """Scale of the half-normal random value added to the least sharpness."""


@dataclass(frozen=True)
class Learning:
    """Weights, rates and schedule of both stages."""

    radiance_field: FieldWeights = field(default_factory=FieldWeights)
    """Loss weights of stage 1."""
    inverse: InverseWeights = field(default_factory=InverseWeights)
    """Loss weights of stage 2."""
    rates: Rates = field(default_factory=Rates)
    """Learning rates."""
    schedule: Schedule = field(default_factory=Schedule)
    """Events of stage 2."""
    light: LightStart = field(default_factory=LightStart)
    """Initial light."""
    nearby: float = 0.01 / 1.5
    """Standard deviation of the displacement of the smoothness losses' nearby positions, local length."""


SHOWN_ONLY = ("shown", "relight_visibility")
"""Fields of ``Variant`` that training does not read."""

INVERSE_ONLY = ("indirect", "visibility", "normals", "background", *SHOWN_ONLY)
"""Fields of ``Variant`` that stage 1 does not read."""


@dataclass(frozen=True)
class Variant:
    """A variant of TensoIR; the defaults are the full method."""

    indirect: bool = True
    """Whether the field's radiance along secondary rays is used as indirect light, in training and under the recovered
    light."""
    visibility: bool = True
    """Whether density occludes the light, in training and under the recovered light."""
    normals: Literal["predicted", "derived"] = "predicted"
    """Shading normals: predicted by the network, which a loss ties to the density, or derived from the density."""
    linear: Literal["later", "from-start"] = "later"
    """Whether the field's radiance is linear from stage 2 on, as published, or in both stages."""
    background: Literal["random-later", "white"] = "random-later"
    """Background of training images: white, as published, which cannot be distinguished from a white surface; or, in
    stage 2, a random grey for each ray. (Random greys in stage 1 would leave the field empty.)"""
    shown: Literal["field", "shaded"] = "field"
    """Images under the recovered light: the marched radiance field, as TensoIR reports them, or shaded."""
    relight_visibility: bool = True
    """Whether density occludes the light in relit images."""
    view_share: float = 1.0
    """Share of the training views that both stages may use, in (0, 1]."""
    learning: Learning = field(default_factory=Learning)
    """Weights, rates and schedule of both stages."""

    def __post_init__(self) -> None:
        if not 0 < self.view_share <= 1:
            raise UsageError(f"view_share: {self.view_share} is not above 0 and at most 1")
        schedule = self.learning.schedule
        for name in ("finer_at", "emptied_at"):
            if any(not 0 <= share < 1 for share in getattr(schedule, name)):
                raise UsageError(f"learning.schedule.{name}: {getattr(schedule, name)} are not all in [0, 1)")

    def of_training(self) -> dict[str, Any]:
        """The fields that the trained model depends on, as plain values."""
        return {name: value for name, value in asdict(self).items() if name not in SHOWN_ONLY}

    def of_field(self) -> dict[str, Any]:
        """The fields that stage 1's radiance field depends on, as plain values."""
        found = {name: value for name, value in asdict(self).items() if name not in INVERSE_ONLY}
        learning = {name: found["learning"][name] for name in ("radiance_field", "rates")}
        return found | {"learning": learning}
