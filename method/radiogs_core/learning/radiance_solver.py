"""The radiance of fixed surfels under a given light, by minimising radiometric inconsistency.

With geometry, materials and light fixed, the radiometric consistency loss is zero where the surfels' radiance solves
the rendering equation. The side of the residual that is traced and shaded, L_PBR, is a target without gradient: every
step moves the radiance towards one more application of the light transport operator, whose only fixed point is global
illumination.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ..kernels.adam import Adam
from ..kernels.shade.shade import shade
from ..scene.camera import Camera
from ..scene.light import EnvironmentMap
from ..scene.light_sampler import LightSampler
from ..surfels.harmonics import surfel_radiance, unclamped_radiance
from ..surfels.surfels import Surfels
from ..transport.sampling import random_hemisphere_direction, relighting_directions
from ..transport.splatting import towards
from ..transport.tracer import SurfelTracer, incident_along
from .backward import backward
from .solver_rates import SolverRates


@dataclass(frozen=True)
class RenderingEquation:
    """Light, albedo and emission of surfels, which determine their radiance."""

    light: EnvironmentMap
    """Distant light."""
    albedo: Float[Tensor, "surfels 3"]
    """Linear albedo, used instead of the surfels', because relighting scales it."""
    emission: Float[Tensor, "surfels 3"] | None = None
    """Emitted radiance, linear RGB, the same in all directions; None: no surfel emits."""
    parts: tuple[int, ...] = (0, 1, 2, 3)
    """Indices of the parts of ``shade`` that are summed: all four, or only the diffuse parts for a furnace."""


@dataclass(frozen=True)
class SolverBudget:
    """Size of a ``RadianceSolver`` run, and its steps."""

    iterations: int
    """Optimisation steps."""
    surfels: int
    """Surfels drawn in each step."""
    samples: int
    """Rays traced from each drawn surfel."""
    rates: SolverRates = field(default_factory=SolverRates)
    """Learning rates."""


class RadianceSolver:
    """Solves a rendering equation for the radiance of surfels, step by step.

    Each step draws ``budget.surfels`` surfels without replacement, traces ``budget.samples`` rays from each (three
    quarters over its hemisphere, the others drawn from the light, combined by the balance heuristic), and minimises the
    l1 residual towards a camera and towards one random direction of its hemisphere.

    Args:
        surfels: Geometry, roughness and initial radiance; only the radiance is learnt.
        equation: Light, albedo and emission.
        cameras: Cameras towards which residuals are taken, one drawn in each step.
        budget: Number of steps, surfels and rays.
        seed: Seed of all random draws.
        tracer: Makes the tracer of the surfels.
        floor: See ``hemisphere_directions``.
    """

    name = "radiance"

    def __init__(
        self,
        surfels: Surfels,
        equation: RenderingEquation,
        cameras: Sequence[Camera],
        budget: SolverBudget,
        seed: int,
        tracer: Callable[[Surfels], SurfelTracer] = SurfelTracer,
        floor: bool = False,
    ) -> None:
        device = surfels.centre.device
        self.fixed = surfels.take(torch.arange(len(surfels), device=device))
        self.equation, self.budget = equation, budget
        self.cameras = [camera.to(device, surfels.centre.dtype) for camera in cameras]
        self.iteration, self.iterations = 0, budget.iterations
        self.generator = torch.Generator(device).manual_seed(seed)
        self.sampler = LightSampler(equation.light)
        self.tracer, self.floor = tracer(self.fixed), floor
        self.drawn = budget.samples // 4
        self.sh = {"sh": self.fixed.sh[:, :1].clone(), "sh_rest": self.fixed.sh[:, 1:].clone()}
        for value in self.sh.values():
            value.requires_grad_()
        self.unit = self._mean_radiance() if budget.rates.unit == "mean radiance" else 1.0
        self.adam = Adam(guard=1e-8)

    @property
    def surfels(self) -> Surfels:
        """The surfels with the current radiance, without gradient."""
        coefficients = torch.cat([value.detach() for value in self.sh.values()], 1)
        return Surfels.of(self.fixed.parameters() | {"sh": coefficients})

    def step(self) -> Mapping[str, float]:
        """One optimisation step; returns the loss by name."""
        surfels = self.surfels
        count = min(self.budget.surfels, len(surfels))
        index = torch.randperm(len(surfels), generator=self.generator, device=surfels.centre.device)[:count]
        camera = self.cameras[int(torch.randint(len(self.cameras), (), generator=self.generator, device=index.device))]
        normal = surfels.frame[index, :, 2]
        to_camera = towards(camera, surfels)[index]
        outgoing = torch.stack([to_camera, random_hemisphere_direction(normal, self.generator)], 1)
        facing = ((outgoing * normal[:, None]).sum(-1) > 0)[..., None]
        target = self.reflected(index, outgoing)
        # Unclamped: max(0, .) has no gradient, so a channel that a long step took below zero would stay there.
        own = unclamped_radiance(torch.cat([value[index] for value in self.sh.values()], 1), outgoing)
        loss = torch.where(facing, own - target, 0.0).abs().sum(1).mean()
        backward(self.name, self.iteration, {"consistency": loss}, self.sh)
        self.adam.step(self.sh, self.rates())
        self.tracer.surfels = self.surfels  # the same geometry, so the tree stays
        self.iteration += 1
        return {"consistency": float(loss.detach())}

    @torch.no_grad()
    def reflected(self, index: Tensor, outgoing: Float[Tensor, "chosen views 3"]) -> Float[Tensor, "chosen views 3"]:
        """L_PBR (Eq. 8) of the surfels at ``index`` towards their ``outgoing`` directions, plus their emission."""
        equation, samples = self.equation, self.budget.samples
        normal = self.fixed.frame[index, :, 2]
        direction, weight = relighting_directions(
            normal, self.sampler, samples - self.drawn, self.drawn, self.generator, self.floor
        )
        incident = incident_along(self.tracer, direction, weight, index=index)
        parts = shade(
            normal, equation.albedo[index], self.fixed.roughness[index], outgoing,
            direction, weight, incident.visibility, incident.radiance, equation.light.radiance,
        )  # fmt: skip
        sent = parts[:, :, list(equation.parts)].sum(2)
        return sent if equation.emission is None else sent + equation.emission[index][:, None]

    def _mean_radiance(self) -> float:
        """Mean radiance of a sample of surfels along their normals, the unit of the learning rates."""
        index = torch.randperm(len(self.fixed), generator=self.generator, device=self.fixed.centre.device)
        index = index[: self.budget.surfels]
        along = self.fixed.frame[index, None, :, 2]
        own = surfel_radiance(self.fixed.sh[index], along)
        return max(float(self.reflected(index, along).mean()), float(own.mean()))

    def rates(self) -> dict[str, float]:
        """Learning rates of the next step, by tensor."""
        rates, progress = self.budget.rates, self.iteration / self.iterations
        decay = rates.last_share + (1 - rates.last_share) * (1 + math.cos(math.pi * progress)) / 2
        whole = rates.degree_0 * self.unit * decay
        return {"sh": whole, "sh_rest": whole * rates.rest_share}

    def state(self) -> dict[str, Any]:
        """Everything needed to continue bit for bit."""
        return {
            "iteration": self.iteration,
            "sh": {name: value.detach() for name, value in self.sh.items()},
            "adam": self.adam.state(),
            "generator": self.generator.get_state(),
            "unit": self.unit,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        self.iteration, self.unit = state["iteration"], state["unit"]
        for name, value in self.sh.items():
            value.data.copy_(state["sh"][name])
        self.adam.restore(state["adam"])
        self.tracer.surfels = self.surfels
        self.generator.set_state(state["generator"])
