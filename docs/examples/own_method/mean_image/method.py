"""A complete method in 150 lines: every camera sees the mean of the training images, lit as brightly as asked.

It knows nothing of space. Its albedo is the mean image divided by the light that it assumes; relit, that albedo is
multiplied by the mean radiance of the new light. docs/your_method.md walks through it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from radiogs_core.contract import MapKind, Maps, Prepared, Run, Stage, StageSpec, Trained, values_of
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.colour import srgb_decode, srgb_encode
from radiogs_core.scene.light import EnvironmentMap


@dataclass(frozen=True)
class Variant:
    """What an ablation may turn.

    every: of the training views every n-th is averaged. irradiance: the light that is assumed, in units of pi.
    """

    every: int = 1
    irradiance: float = 1.0


@dataclass(frozen=True)
class Budget:
    """How much work a run may do. views: training views that are averaged, at most."""

    name: str
    views: int


PRESETS = {name: Budget(name, views) for name, views in (("smoke", 4), ("tiny", 16), ("small", 64), ("paper", 1000))}


class Averaging:
    """The one stage: each step adds one training view to the sum. See ``radiogs_core.contract.Stage``."""

    def __init__(self, run: Run) -> None:
        self.views = run.scene.train[:: run.variant.every][: run.budget.views]
        self.iteration, self.iterations = 0, len(self.views)
        height, width = self.views[0].camera.height, self.views[0].camera.width
        self.total = torch.zeros(height, width, 4, device=run.device)  # linear radiance times coverage, coverage

    def step(self) -> Mapping[str, float]:
        """Add one view; the loss is its distance from the mean so far, which shows whether averaging settles."""
        view = self.views[self.iteration]
        alpha = view.read("alpha") if view.has("alpha") else torch.ones(*view.read("image").shape[:2], 1)
        seen = torch.cat([srgb_decode(view.read("image")) * alpha, alpha], -1).to(self.total.device)
        distance = (seen - self.total / max(1, self.iteration)).abs().mean()
        self.total += seen
        self.iteration += 1
        return {"distance": float(distance)}

    def state(self) -> dict[str, Any]:
        """All that is needed to go on."""
        return {"iteration": self.iteration, "total": self.total}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        self.iteration, self.total = state["iteration"], state["total"].clone()

    def product(self) -> dict[str, Any]:
        """The mean image, with coverage as its fourth channel."""
        return {"mean": self.total / max(1, self.iteration)}


class TrainedMean:
    """A mean image. See ``radiogs_core.contract.Trained``."""

    light = None  # none is found

    def __init__(self, mean: Tensor, run: Run) -> None:
        self.mean, self.run = mean, run

    def facts(self) -> dict[str, Any]:
        """What goes into the result beside the metrics."""
        return {"brightness": float(self.mean[..., :3].mean())}

    def export(self, folder: Path) -> list[Path]:
        """One file for other programs."""
        path = folder / "mean_image.pt"
        torch.save({"mean": self.mean}, path)
        return [path]

    def prepare(
        self,
        light: EnvironmentMap | None = None,
        albedo_scale: Tensor | None = None,
        after_step: Callable[[], None] = lambda: None,
    ) -> Prepared:
        """Under the assumed light, or as bright as another one is on average."""
        albedo = self.mean[..., :3] / self.run.variant.irradiance
        irradiance = torch.full((3,), self.run.variant.irradiance)
        if light is not None:
            albedo = albedo * (1.0 if albedo_scale is None else albedo_scale.to(albedo))
            irradiance = light.radiance.mean((0, 1))
        return Shown(albedo, irradiance.to(albedo), self.mean[..., 3:])


class Shown:
    """Every camera sees the same image. See ``radiogs_core.contract.Prepared``."""

    offers: Mapping[str, MapKind] = {"image": MapKind("display"), "alpha": MapKind("data"), "albedo": MapKind("linear")}
    default = frozenset(offers)
    timed = True

    def __init__(self, albedo: Tensor, irradiance: Tensor, alpha: Tensor) -> None:
        self.albedo, self.irradiance, self.alpha = albedo, irradiance, alpha

    def render(self, camera: Camera, *further: str) -> Maps:
        """All maps are on black: multiplied by coverage, as ``MapKind`` says unless told otherwise."""
        image = srgb_encode(self.albedo * self.irradiance).clamp(0, 1)
        return {"image": image, "alpha": self.alpha, "albedo": self.albedo}


class MeanImage:
    """The method. See ``radiogs_core.contract.Method``."""

    name = "mean-image"
    title = "Mean image"
    variant = Variant
    presets: Mapping[str, Budget] = PRESETS
    sources = ("mean_image.method",)

    def stages(self, variant: Variant, budget: Budget) -> Sequence[StageSpec]:
        """One stage. It does not read the irradiance: rows that differ in that alone share its outcome."""
        return (
            StageSpec(
                name="average",
                title="averaging",
                steps=budget.views,
                owner=self.name,
                reads={**values_of(variant, "every"), **values_of(budget, "views")},
                sources=self.sources,
                begin=lambda run, before: _averaging(run),
            ),
        )

    def restore(self, run: Run, tensors: Mapping[str, Any]) -> Trained:
        """The model from the product of the stage."""
        return TrainedMean(tensors["mean"], run)


def _averaging(run: Run) -> Stage:
    return Averaging(run)


MEAN_IMAGE = MeanImage()
