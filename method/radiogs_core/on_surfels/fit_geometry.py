"""``fit_geometry``: surfels from posed images by novel-view synthesis alone, with the losses of 2DGS.

The first stage of every surfel method: what a method learns besides (its own shading of the same surfels) is a
``Shading`` that it hands to the stage. Surfels that make up little of every image are found in all training views.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from ..contract import Run, StageSpec
from ..errors import DataError
from ..kernels.image.display import displayed
from ..kernels.image.edges import edge_allowance, edge_aware_smoothness
from ..learning.geometry import GeometryLearning, turning
from ..learning.losses import mask_entropy, normal_consistency, reconstruction
from ..learning.views import TrainingView
from ..scene.camera import Camera
from ..scene.contraction import Contraction
from ..scene.scene import Scene, View
from ..surfels.density import AdaptiveDensityControl, DensityControl
from ..surfels.optimiser import SurfelOptimiser
from ..surfels.starting_points import initial_surfels
from ..surfels.surfels import Surfels
from ..surfels.surroundings import surrounded_surfels
from ..transport.blending_weights import blending_weights
from ..transport.splatting import Splat, own_radiance_twice, splat
from .settings import GeometryBudget
from .stage import SurfelStage

DECAYING = ("rotation", "log_scale", "opacity_logit", "sh", "sh_rest")
"""Parameters of surfels whose rates fall in the later part of the stage."""

SHAPE = ("rotation", "log_scale")
"""Those of them that stay as they start while surfels do not move yet."""


@runtime_checkable
class Shading(Protocol):
    """What is learnt from the same images besides the surfels' radiance: materials, and the light on them."""

    tensors: Mapping[str, Tensor]
    """Tensors to be learnt besides the surfels, by name, as they start."""
    rates: Mapping[str, float]
    """Learning rates of these, and of the surfels' materials by their raw parameters' names."""
    image_weight: float
    """Weight of the losses of ``images``, beside that of the surfels' own radiance."""
    geometry_gradient: bool
    """Whether the images' losses have gradient to the surfels' places, rotations, scales and opacities."""

    def images(
        self, surfels: Surfels, own: Tensor, tensors: Mapping[str, Tensor], camera: Camera, progress: float
    ) -> tuple[Mapping[str, Float[Tensor, "surfels 3"]], Mapping[str, Tensor]]:
        """Linear radiance of each surfel towards the camera by name, to be compared with the training image, and
        further weighted losses by name. ``own``: L_G of each surfel towards the camera, with gradient to its
        harmonics alone; ``tensors`` as learnt so far; ``progress``: share of the stage that is done."""


class NoShading:
    """Novel-view synthesis alone: materials stay as they start."""

    tensors: Mapping[str, Tensor] = {}
    rates: Mapping[str, float] = {"albedo_logit": 0.0, "roughness_logit": 0.0}
    image_weight = 1.0
    geometry_gradient = False

    def images(
        self, surfels: Surfels, own: Tensor, tensors: Mapping[str, Tensor], camera: Camera, progress: float
    ) -> tuple[Mapping[str, Float[Tensor, "surfels 3"]], Mapping[str, Tensor]]:
        """Nothing."""
        return {}, {}


class FitGeometry(SurfelStage[Any, Any]):
    """Surfels from the training views of a scene. A ``contract.Stage``; what it hands on is its state."""

    name = "geometry"

    def __init__(
        self,
        run: Run[Any, Any],
        learning: GeometryLearning,
        budget: GeometryBudget,
        view_share: float,
        shading: Shading,
    ) -> None:
        super().__init__(run, budget.steps, view_share)
        scene, self.learning, self.shading = run.scene, learning, shading
        self.geometry_rate = budget.rate
        self.unit_rate = scene.extent * budget.rate
        self.space = Contraction.of(scene) if scene.surrounded else None
        surfels = self._start(scene, tuple(view.reread() for view in self.views), budget.initial_surfels)
        self.optimiser = SurfelOptimiser(surfels, shading.tensors, self._rates(budget.rate))
        self.density: DensityControl = AdaptiveDensityControl(
            learning.density, budget.densify_interval, budget.maximum_surfels, scene.extent, surfels,
            lambda surfels: largest_contribution(surfels, self.views),
            None if self.space is None else self.space.stretch,
        )  # fmt: skip

    def _start(self, scene: Scene, views: tuple[View, ...], count: int) -> Surfels:
        """Drawn on the CPU, so that every kind of device starts with the same surfels."""
        generator, linear = torch.Generator().manual_seed(self.seed), self.learning.colour == "linear"
        if scene.surrounded:
            around = self.learning.surroundings
            surfels = surrounded_surfels(scene, views, count, self.learning.start, around, linear, generator)
        else:
            surfels = initial_surfels(scene, views, count, self.learning.start, linear, generator)
        return Surfels.of({name: value.to(self.device) for name, value in surfels.parameters().items()})

    def _rates(self, geometry_rate: float) -> dict[str, float]:
        rates = self.learning.rates
        return {
            "centre": self.position_rate(),
            "rotation": rates.rotation * turning(geometry_rate),
            "log_scale": rates.scale,
            "opacity_logit": rates.opacity,
            "sh": rates.radiance,
            "sh_rest": rates.radiance_rest,
            **self.shading.rates,
        }

    def position_rate(self) -> float:
        """World units a step: none at first, geometric between the first and the last rate, then constant."""
        if self._still():
            return 0.0
        rates, until = self.learning.rates, self.learning.schedule.position_decay_until
        progress = min(1.0, self.iteration / max(1.0, until * self.iterations))
        return rates.position ** (1 - progress) * rates.position_end**progress * self.unit_rate

    def _still(self) -> bool:
        """Whether surfels only take their colours yet, where they start on swept surfaces."""
        swept = self.space is None and self.learning.start.points == "swept"
        return swept and self.iteration < self.learning.schedule.moving_from * self.iterations

    @property
    def surfels(self) -> Surfels:
        """What is learnt so far."""
        return self.optimiser.surfels

    def begin_step(self) -> None:
        """Positions fall by their own schedule, the other rates of surfels from ``schedule.decay_from`` on."""
        begin, end = self.learning.schedule.decay_from, self.learning.rates.end_share
        progress = max(0.0, (self.iteration / self.iterations - begin) / (1 - begin))
        rates = self._rates(self.geometry_rate)
        self.optimiser.set_rate("centre", rates["centre"])
        for name in DECAYING:
            held = self._still() and name in SHAPE
            self.optimiser.set_rate(name, 0.0 if held else rates[name] * end**progress)

    def move(self, view: TrainingView) -> None:
        """Step the optimiser, then add and remove surfels when density control is due."""
        centre = self.optimiser.tensors["centre"]
        if centre.grad is not None:
            self.density.observe(view.camera, centre.detach(), centre.grad, self.touched)
        before = centre.detach().clone() if self.space is not None else None
        self.optimiser.step()
        if self.space is not None and before is not None:
            with torch.no_grad():  # what lies beyond the cameras moves as far as it looks
                centre.copy_(before + (centre - before) * self.space.stretch(before)[:, None])
        done = self.iteration + 1
        if self.density.due(done, self.iterations):
            changed = self.density.act(self.optimiser.surfels, done, self.iterations, self.generator)
            require_some(changed[0], done)
            self.optimiser.replace(*changed)

    def losses(self, view: TrainingView) -> dict[str, Tensor]:
        """The weighted losses of the next step by name; ``touched`` then says which surfels the view shows."""
        surfels = self.optimiser.surfels.with_cached_frames()
        surfels.sh = surfels.sh[:, : self._coefficients()]
        weights, camera = self.learning.weights, view.camera
        radiance, own = own_radiance_twice(camera, surfels)
        progress = self.iteration / self.iterations
        shaded, further = self.shading.images(surfels, own, self.optimiser.tensors, camera, progress)
        detached = () if self.shading.geometry_gradient else shaded.keys()
        seen = splat(camera, surfels, {"radiance": radiance, **shaded}, self.depth_unit, detached)
        losses = {**further, **self._image_losses(seen, view)}
        target = seen.depth_normal(camera, self.learning.normal_target == "one-sided")
        losses["normal"] = self._normal_weight() * normal_consistency(seen.normal, seen.alpha, target)
        losses["mask"] = weights.mask * mask_entropy(seen.alpha, view.mask)
        if self.iteration >= self.learning.schedule.distortion_from * self.iterations:
            losses["distortion"] = weights.distortion * mean_distortion(seen, self.depth_unit, self.space is not None)
        inside = None if self.learning.across_silhouettes else view.mask
        allowance = edge_allowance(view.over(0.0), self.learning.edge_sharpness, inside)
        smoothness = edge_aware_smoothness(seen.normal, allowance)
        losses["normal smoothness"] = weights.normal_smoothness * smoothness
        self.touched = seen.touched
        return losses

    def _normal_weight(self) -> float:
        late = self.iteration >= self.learning.schedule.normal_late_from * self.iterations
        return self.learning.weights.normal_late if late else self.learning.weights.normal

    def _image_losses(self, seen: Splat, view: TrainingView) -> dict[str, Tensor]:
        """Every blended image against the training image, on the background whose turn it is; the first is L_G's."""
        backgrounds, weights = self.learning.backgrounds, self.learning.weights
        background = backgrounds[self.iteration % len(backgrounds)]
        target = view.over(background)
        own, *others = seen.images.values()
        covered = seen.alpha if self.shading.geometry_gradient else seen.alpha.detach()
        composited = [self._composited(own[None], seen.alpha, background)]
        if others:
            composited.append(self._composited(torch.stack(others), covered, background))
        found = reconstruction(torch.cat(composited), target, weights.absolute, weights.similarity)
        radiance, *shaded = zip(seen.images, found.unbind(), strict=True)
        return dict([radiance]) | {name: self.shading.image_weight * loss for name, loss in shaded}

    def _composited(
        self, blended: Float[Tensor, "images height width 3"], alpha: Float[Tensor, "height width"], background: float
    ) -> Float[Tensor, "images height width 3"]:
        """Blended images in display sRGB, over a grey background."""
        if self.learning.colour == "linear":
            return displayed(blended, alpha, self.learning.encoding == "straight", background)
        return composite(blended, alpha, background)

    def _coefficients(self) -> int:
        degree = sum(self.iteration >= share * self.iterations for share in self.learning.schedule.degrees_from)
        return (degree + 1) ** 2

    def state(self) -> dict[str, Any]:
        """Everything needed to continue bit for bit."""
        return super().state() | {"density": self.density.state()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        super().restore(state)
        self.density.restore(state["density"])

    def product(self) -> dict[str, Any]:
        """What the next stage begins from: the state (see ``surfels_of``)."""
        return self.state()


def fit_geometry(learning: GeometryLearning, budget: object, view_share: float = 1.0) -> StageSpec[Any, Any]:
    """The stage for ``Method.stages``: methods that ask for the same geometry train it once.

    ``budget``: a ``GeometryBudget``; a budget with flat fields works for one more release (``GeometryBudget.of``).
    """
    half = GeometryBudget.of(budget)
    return StageSpec(
        name="geometry",
        title="stage 1, geometry",
        steps=half.steps,
        owner="radiogs_core",
        reads={"learning": asdict(learning), "view_share": view_share, "budget": asdict(half)},
        sources=(__name__,),
        begin=lambda run, _: FitGeometry(run, learning, half, view_share, NoShading()),
        compiles=True,
    )


def surfels_of(state: Mapping[str, Any], device: torch.device) -> Surfels:
    """The surfels in a stage's saved state."""
    tensors = {name: value.to(device) for name, value in state["optimiser"]["tensors"].items()}
    tensors["sh"] = torch.cat([tensors["sh"], tensors.pop("sh_rest")], 1)
    return Surfels.of({name: tensors[name] for name in Surfels.names()})


def require_some(surfels: Surfels, iteration: int) -> None:
    """Raises DataError where density control has left no surfel: there is nothing to learn any more."""
    if len(surfels) == 0:
        raise DataError(
            f"no surfel is left after step {iteration} of stage 1",
            "All of them were too faint, too large, or too small to show in any training view.",
            "Look at the scene (radiogs-bench datasets check), or begin with more surfels: a larger preset.",
        )


def mean_distortion(seen: Splat, depth_unit: float, surrounded: bool) -> Float[Tensor, ""]:
    """Mean distortion over pixels (2DGS); in a scene with surroundings, that of disparity beyond the cameras' distance.

    ``depth_unit``: the cameras' mean distance from the scene's centre, world units.
    """
    if not surrounded:
        return seen.distortion.mean()
    beyond = (seen.depth.detach() / depth_unit).clamp(min=1)
    return (seen.distortion / beyond**4).mean()


def composite(display: Tensor, alpha: Tensor, background: float) -> Tensor:
    """A blended image in display sRGB, over a grey background."""
    return display + background * (1 - alpha)[..., None]


def largest_contribution(surfels: Surfels, views: Sequence[TrainingView]) -> Float[Tensor, " surfels"]:
    """The sum of a surfel's blending weights over the pixels of a view, in the view where it is largest; pixels."""
    largest = torch.zeros_like(surfels.opacity_logit, requires_grad=False)
    for view in views:
        largest = torch.maximum(largest, blending_weights(view.camera, surfels))
    return largest
