"""``fit_geometry``: surfels from posed images by novel-view synthesis alone, with the losses of 2DGS.

It is the first stage of every method on surfels. A method that learns more from the same images (materials and light,
by its own shading of the surfels) passes a ``Shading``. Density control removes surfels that contribute little to all
training views.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ..contract import Run, StageSpec
from ..errors import DataError
from ..kernels.image.terms import Aim, Blended, Compared, Terms, image_terms
from ..learning.geometry import GeometryLearning, turning
from ..learning.losses import counted, edge_weights
from ..learning.views import TrainingView
from ..scene.camera import Camera
from ..scene.contraction import Contraction
from ..scene.scene import Scene, View
from ..surfels.density import AdaptiveDensityControl
from ..surfels.optimiser import SurfelOptimiser
from ..surfels.starting_points import initial_surfels
from ..surfels.surfels import Surfels
from ..surfels.surroundings import surrounded_surfels
from ..transport.blending_weights import blending_weights
from ..transport.splatting import own_radiance_twice, splat
from .settings import GeometryBudget
from .splat_start import splat_surfels
from .stage import SurfelStage

DECAYING = ("rotation", "log_scale", "opacity_logit", "sh", "sh_rest")
"""Parameters of surfels whose rates fall in the later part of the stage."""

SHAPE = ("rotation", "log_scale")
"""The parameters of ``DECAYING`` that are frozen while only colours are learnt (``schedule.moving_from``)."""


class Shading:
    """Materials and light that are learnt from the training images together with the surfels' radiance.

    This class learns none, which is novel-view synthesis alone: the materials keep their initial values.
    """

    tensors: Mapping[str, Tensor] = {}
    """Initial values, by name, of the tensors that are learnt in addition to the surfels."""
    rates: Mapping[str, float] = {"albedo_logit": 0.0, "roughness_logit": 0.0}
    """Learning rates of these tensors, and of the surfels' materials by the names of their raw parameters."""
    image_weight = 1.0
    """Weight of the reconstruction losses of ``images``; the loss of the surfels' own radiance has weight 1."""
    geometry_gradient = False
    """Whether these losses have gradient to the surfels' positions, rotations, scales and opacities."""

    def images(
        self, surfels: Surfels, own: Tensor, tensors: Mapping[str, Tensor], camera: Camera, progress: float
    ) -> tuple[Mapping[str, Float[Tensor, "surfels 3"]], Mapping[str, Tensor]]:
        """Two mappings by name: linear radiance of each surfel towards the camera, and further weighted losses.

        Each radiance is blended and compared with the training image. ``own``: L_G of each surfel towards the camera,
        [surfels, 3], with gradient to its harmonics alone. ``tensors``: the present values of ``Shading.tensors``.
        ``progress``: share of the stage's steps that are done. Without a subclass both are empty.
        """
        return {}, {}


class FitGeometry(SurfelStage[Any, Any]):
    """Learns surfels from the training views of a scene. A ``contract.Stage``; its product is its state."""

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
        if learning.start.splat:  # the schedule goes on from where splats are as good as what it has made by then
            self.iteration = round(learning.start.splat_skips * budget.steps)
        self.unit_rate = scene.extent * budget.rate
        self.space = Contraction.of(scene) if scene.surrounded else None
        views = self.views  # the density control keeps them, not the stage: in a cycle the stage would not be freed
        surfels = self._start(scene, tuple(view.reread() for view in views), budget.initial_surfels)
        self.optimiser = SurfelOptimiser(surfels, shading.tensors, self._rates(budget.rate))
        self.density = AdaptiveDensityControl(
            learning.density, budget.densify_interval, budget.maximum_surfels, scene.extent, surfels,
            lambda surfels: largest_contribution(surfels, views),
            None if self.space is None else self.space.stretch,
        )  # fmt: skip

    def _start(self, scene: Scene, views: tuple[View, ...], count: int) -> Surfels:
        """``count`` initial surfels, or the file's splats, made on the CPU so that every device starts alike."""
        generator, linear = torch.Generator().manual_seed(self.seed), self.learning.colour == "linear"
        if self.learning.start.splat:
            surfels = splat_surfels(self.learning.start, [view.camera for view in views], linear)
        elif scene.surrounded:
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
        """Learning rate of positions, world units: 0 at first, then a geometric decay, then constant."""
        if self._still():
            return 0.0
        rates, until = self.learning.rates, self.learning.schedule.position_decay_until
        progress = min(1.0, self.iteration / max(1.0, until * self.iterations))
        return rates.position ** (1 - progress) * rates.position_end**progress * self.unit_rate

    def _still(self) -> bool:
        """Whether only colours are learnt now; True at first for surfels that start on swept surfaces."""
        swept = self.space is None and self.learning.start.points == "swept"
        return swept and self.iteration < self.learning.schedule.moving_from * self.iterations

    @property
    def surfels(self) -> Surfels:
        """The surfels in their present state."""
        return self.optimiser.surfels

    def begin_step(self) -> None:
        """Set the learning rates of this step; after ``schedule.decay_from``, all but the positions' decay."""
        begin, end = self.learning.schedule.decay_from, self.learning.rates.end_share
        progress = max(0.0, (self.iteration / self.iterations - begin) / (1 - begin)) if begin < 1 else 0.0
        rates = self._rates(self.geometry_rate)
        self.optimiser.set_rate("centre", rates["centre"])
        for name in DECAYING:
            frozen = self._still() and name in SHAPE
            self.optimiser.set_rate(name, 0.0 if frozen else rates[name] * end**progress)

    def move(self, view: TrainingView) -> None:
        """Step the optimiser, then add and remove surfels when density control is due."""
        centre = self.optimiser.tensors["centre"]
        if centre.grad is not None:
            self.density.observe(view.camera, centre.detach(), centre.grad, self.touched)
        before = centre.detach().clone() if self.space is not None else None
        self.optimiser.step()
        if self.space is not None and before is not None:
            with torch.no_grad():  # beyond the cameras, a step is stretched with the distance
                centre.copy_(before + (centre - before) * self.space.stretch(before)[:, None])
        done = self.iteration + 1
        if self.density.due(done, self.iterations):
            opacity = self.optimiser.surfels.opacity_logit
            changed, origin = self.density.act(self.optimiser.surfels, done, self.iterations, self.generator)
            require_some(changed, done)
            self.optimiser.replace(changed, origin)
            kept = origin >= 0
            if not torch.equal(changed.opacity_logit[kept], opacity[origin[kept]]):
                self.optimiser.forget("opacity_logit")

    def losses(self, view: TrainingView) -> dict[str, Tensor]:
        """The weighted losses of the next step by name; sets ``touched``, the mask of surfels that the view shows."""
        surfels = self.optimiser.surfels.with_cached_values()
        degree = sum(self.iteration >= share * self.iterations for share in self.learning.schedule.degrees_from)
        surfels.sh = surfels.sh[:, : (degree + 1) ** 2]
        camera = view.camera
        radiance, own = own_radiance_twice(camera, surfels)
        progress = self.iteration / self.iterations
        shaded, further = self.shading.images(surfels, own, self.optimiser.tensors, camera, progress)
        detached = () if self.shading.geometry_gradient else shaded.keys()
        seen = splat(camera, surfels, {"radiance": radiance, **shaded}, self.depth_unit, detached)
        self.touched = seen.touched
        terms = self._terms(tuple(shaded))
        allowance = None
        if terms.smoothness:
            allowance = edge_weights(view, self.learning.edge_sharpness, self.learning.across_silhouettes)
        aim = Aim(view.over(terms.background), view.mask, allowance)
        blended = Blended(seen.alpha, seen.normal, seen.depth, seen.distortion)
        aim, blended, images = counted(view, terms.background, aim, blended, tuple(seen.images.values()))
        return {**further, **image_terms(terms, camera, aim, blended, images)}

    def _terms(self, shaded: tuple[str, ...]) -> Terms:
        """The image losses of this step; ``shaded``: names of the images besides L_G's."""
        learning, weights, schedule = self.learning, self.learning.weights, self.learning.schedule
        backgrounds, factor = learning.backgrounds, self.shading.image_weight
        attached = self.shading.geometry_gradient
        own = Compared("radiance", weights.radiance * weights.absolute, weights.radiance * weights.similarity)
        others = (Compared(name, factor * weights.absolute, factor * weights.similarity, attached) for name in shaded)
        smooth = self.iteration <= schedule.normal_smoothness_until * self.iterations
        late = self.iteration >= schedule.normal_late_from * self.iterations
        return Terms(
            images=(own, *others),
            encoding=learning.encoding if learning.colour == "linear" else "display",
            background=backgrounds[self.iteration % len(backgrounds)],
            mask=weights.mask,
            normal=weights.normal_late if late else weights.normal,
            one_sided=learning.normal_target == "one-sided",
            distortion=weights.distortion if self.iteration >= schedule.distortion_from * self.iterations else 0.0,
            far=0.0 if self.space is None else self.depth_unit,
            smoothness=(("normal smoothness", weights.normal_smoothness),) if smooth else (),
        )

    def state(self) -> dict[str, Any]:
        """Tensors and plain values from which ``restore`` continues bit for bit."""
        return super().state() | {"density": self.density.state()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        super().restore(state)
        self.density.restore(state["density"])

    def product(self) -> dict[str, Any]:
        """The state, from which the next stage begins (see ``surfels_of``)."""
        return self.state()


def fit_geometry(learning: GeometryLearning, budget: object, view_share: float = 1.0) -> StageSpec[Any, Any]:
    """Stage 1 for ``Method.stages``. Methods with equal arguments share one training of it.

    ``budget``: a ``GeometryBudget``; a budget with flat fields works for one more release (``GeometryBudget.of``).
    ``view_share``: share of the training views that are used, in (0, 1].
    """
    half = GeometryBudget.of(budget)
    return StageSpec(
        name="geometry",
        title="stage 1, geometry",
        steps=half.steps,
        owner="radiogs_core",
        reads={"learning": asdict(learning), "view_share": view_share, "budget": asdict(half)},
        sources=(__name__,),
        begin=lambda run, _: FitGeometry(run, learning, half, view_share, Shading()),
        compiles=True,
    )


def surfels_of(state: Mapping[str, Any], device: torch.device) -> Surfels:
    """The surfels in the state of ``FitGeometry``, on ``device``."""
    tensors = {name: value.to(device) for name, value in state["optimiser"]["tensors"].items()}
    tensors["sh"] = torch.cat([tensors["sh"], tensors.pop("sh_rest")], 1)
    return Surfels.of({name: tensors[name] for name in Surfels.names()})


def require_some(surfels: Surfels, iteration: int) -> None:
    """Raises DataError if density control has removed all surfels, because nothing is left to learn."""
    if len(surfels) == 0:
        raise DataError(
            f"no surfel is left after step {iteration} of stage 1",
            "All of them were too faint, too large, or too small to show in any training view.",
            "Check the scene (radiogs-bench datasets check), or use a larger preset, which begins with more surfels.",
        )


def largest_contribution(surfels: Surfels, views: Sequence[TrainingView]) -> Float[Tensor, " surfels"]:
    """Largest sum, over the views, of each surfel's blending weights in the pixels of one view; in pixels."""
    largest = torch.zeros_like(surfels.opacity_logit, requires_grad=False)
    for view in views:
        largest = torch.maximum(largest, blending_weights(view.camera, surfels))
    return largest
