"""A lobe that is left out is scattered by Lambert's law: by quadrature, in a white furnace, and by whoever shades."""

import dataclasses
from typing import Any

import numpy as np
import pytest
import torch

from radiogs.consistency import RadiometricConsistency
from radiogs.effects.probe_scene import PlanRadiance, ProbeRays, ProbeView, Viewpoints, trace_scene
from radiogs.model import Model
from radiogs.rays import RaySettings
from radiogs.relighting import RelitByRays
from radiogs.settings import Variant
from radiogs.showing import Renderer
from radiogs_core.instruments import recording
from radiogs_core.kernels.shade.brdf import specular
from radiogs_core.kernels.shade.shade import shade
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.surfels import Surfels, radiance_to_sh
from radiogs_core.transport.incident import unoccluded
from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.shading import lobe_albedo, shade_materials
from radiogs_core.transport.splatting import shade_surfels, towards
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import Sphere
from reference.quadrature import lobe_quadrature
from scenes import look_at, surfels_over

F64 = torch.float64
NORMAL = torch.tensor([0.0, 0.0, 1.0], dtype=F64)


def gauss(nodes: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Cosines in (0, 1) and weights of Gauss-Legendre that add up to 1."""
    place, weight = np.polynomial.legendre.leggauss(nodes)
    return torch.from_numpy((place + 1) / 2), torch.from_numpy(weight / 2)


@pytest.mark.parametrize("roughness", [0.05, 0.1, 0.23, 0.4, 0.55, 0.8, 1.0])
def test_the_lobes_albedo_is_the_double_integral_of_the_brdf(roughness: float) -> None:
    """E = 2 integral of n.wo (integral of f_s n.wi d(wi)) d(n.wo), in float64 and of ``brdf.specular`` itself."""
    expected = 0.0
    for cosine, weight in zip(*gauss(24), strict=True):
        wo, wi, solid_angle = lobe_quadrature(float(cosine), roughness, steps=80)
        views, normals = wo.expand_as(wi), NORMAL.expand_as(wi)
        lobe = specular(normals, views, wi, torch.full((len(wi),), roughness, dtype=F64))
        expected += float(2 * weight * cosine * (lobe * wi[:, 2].clamp(min=0) * solid_angle).sum())
    # The table of A and B is as accurate: 0.2 % at most.
    assert float(lobe_albedo(torch.tensor([roughness], dtype=F64))) == pytest.approx(expected, rel=3e-3)


def furnace(roughness: float, shiny: bool) -> torch.Tensor:
    """The four parts of a grey surfel's radiance, [4], as a cosine-weighted mean over views, under a light of 1."""
    cosine, weight = gauss(32)
    outgoing = torch.stack([(1 - cosine.square()).sqrt(), torch.zeros_like(cosine), cosine], -1)[None]
    incident = unoccluded(*hemisphere_directions(NORMAL[None], 20_000, None))
    parts = shade_materials(
        NORMAL[None], torch.full((1, 3), 0.4, dtype=F64), torch.tensor([roughness], dtype=F64), outgoing, incident,
        torch.ones(4, 8, 3, dtype=F64), torch.tensor([shiny]),
    )  # fmt: skip
    return (2 * cosine * weight) @ parts[0, :, :, 0]


@pytest.mark.parametrize("roughness", [0.4, 0.6, 0.8, 1.0])
def test_in_a_white_furnace_a_surfel_sends_as_much_without_its_lobe(roughness: float) -> None:
    with_lobe, without = furnace(roughness, True), furnace(roughness, False)
    assert float(without[2:].abs().max()) == 0.0
    energy = float(with_lobe.sum())
    assert float(without.sum()) == pytest.approx(energy, rel=2e-4)
    # Lambert's law alone would lack all that the lobe sends: 4 to 9 % here.
    assert float(with_lobe[:2].sum()) < 0.965 * energy


def ball(roughness: float = 0.7) -> Surfels:
    return surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, Material((0.6, 0.5, 0.4), roughness))], 0.2)


CAMERA = look_at(torch.tensor([2.5, 0.3, 0.8]), torch.zeros(3), 24, 40.0)


def sky() -> torch.Tensor:
    return torch.rand(8, 16, 3, generator=torch.Generator().manual_seed(0)) + 0.1


def test_surfels_with_a_lobe_are_shaded_as_they_were_and_others_evaluate_none() -> None:
    surfels, light = ball(), sky()
    incident = unoccluded(*hemisphere_directions(surfels.frame[..., 2], 16, None))
    outgoing = towards(CAMERA, surfels)[:, None]
    shiny = torch.arange(len(surfels)) % 3 == 0
    whole = shade_surfels(surfels, surfels.albedo, incident, outgoing, light)
    with recording() as instruments:
        some = shade_surfels(surfels, surfels.albedo, incident, outgoing, light, shiny)
    assert instruments.work["lobes"] == 16 * int(shiny.sum())
    assert torch.equal(some[shiny], whole[shiny])
    scale = 1 + lobe_albedo(surfels.roughness[~shiny])[:, None] / surfels.albedo[~shiny]
    torch.testing.assert_close(some[~shiny][:, 0, 0], whole[~shiny][:, 0, 0] * scale)
    assert not some[~shiny][:, :, 2:].any()


def test_without_a_lobe_roughness_learns_nothing_and_albedo_as_by_lamberts_law() -> None:
    surfels, light = ball(), sky()
    incident = unoccluded(*hemisphere_directions(surfels.frame[..., 2], 16, None))
    given = {name: value.clone().requires_grad_() for name, value in surfels.parameters().items()}
    surfels, none = Surfels.of(given), torch.zeros(len(surfels), dtype=torch.bool)
    outgoing = towards(CAMERA, surfels)[:, None]
    shade_surfels(surfels, surfels.albedo, incident, outgoing, light, none).sum().backward()
    assert surfels.roughness_logit.grad is None or not surfels.roughness_logit.grad.any()
    substituted = surfels.albedo_logit.grad
    surfels.albedo_logit.grad = None
    diffuse = shade(
        surfels.frame[..., 2], surfels.albedo, surfels.roughness, outgoing,
        incident.direction, incident.weight, incident.visibility, incident.radiance, light,
    )[:, :, :2]  # fmt: skip
    diffuse.sum().backward()
    assert substituted is not None
    assert surfels.albedo_logit.grad is not None
    torch.testing.assert_close(substituted, surfels.albedo_logit.grad)


def test_radiance_that_a_matt_surface_sends_in_a_furnace_is_consistent() -> None:
    """L_G = (albedo + E) L leaves no residual in L_rad: the directions' cosines add up to pi exactly."""
    surfels = ball()
    sent = 0.7 * (surfels.albedo + lobe_albedo(surfels.roughness)[:, None])
    own = torch.cat([radiance_to_sh(sent)[:, None], torch.zeros_like(surfels.sh[:, 1:])], 1)
    surfels = Surfels.of(surfels.parameters() | {"sh": own})
    incident = unoccluded(*hemisphere_directions(surfels.frame[..., 2], 16, None))
    index, light = torch.arange(len(surfels)), torch.full((8, 16, 3), 0.7)

    def residual(specular: torch.Tensor | None) -> float:
        seeded = torch.Generator().manual_seed(0)
        return float(RadiometricConsistency().loss(surfels, light, CAMERA, index, incident, seeded, specular))

    assert residual(torch.zeros(len(surfels), dtype=torch.bool)) < 1e-6
    assert residual(None) > 1e-3


@pytest.mark.parametrize(
    "plan",
    [
        EffectPlan(),
        EffectPlan().without("specular"),
        EffectPlan().without("specular").without("indirect"),
    ],
)
def test_a_probe_shades_like_rendering(plan: EffectPlan) -> None:
    surfels, light = (
        surfels_over([Sphere((0.0, 0.0, s), 0.4, Material((0.6, 0.5, 0.4), 0.7)) for s in (-0.5, 0.5)], 0.2),
        sky(),
    )
    rays = ProbeRays(16, torch.Generator().manual_seed(0), RaySettings())
    made = trace_scene(surfels, light, Viewpoints((ProbeView(CAMERA, None),), straight=True), rays)
    judged = PlanRadiance(made).shaded(plan).detach()
    incident = (
        made.incident if plan.indirect else dataclasses.replace(made.incident, radiance=0 * made.incident.radiance)
    )
    outgoing = towards(CAMERA, surfels)[:, None]
    specular_at = plan.specular_among(surfels.albedo)
    rendered = shade_surfels(surfels, surfels.albedo, incident, outgoing, light, specular_at).sum(2)
    torch.testing.assert_close(judged, rendered, rtol=1e-5, atol=1e-7)


def test_maps_report_the_albedo_itself() -> None:
    surfels, light = ball(), sky()
    plan = EffectPlan().without("specular")
    maps: list[dict[str, Any]] = [
        Renderer(Model(surfels, light.log(), each), 16, Variant()).render(CAMERA) for each in (EffectPlan(), plan)
    ]
    tracer_free = unoccluded(*hemisphere_directions(surfels.frame[..., 2], 16, None))
    maps += [
        RelitByRays(surfels, surfels.albedo, EnvironmentMap(light), tracer_free, each).render(CAMERA)
        for each in (EffectPlan(), plan)
    ]
    for each in maps[1:]:
        assert torch.equal(each["albedo"], maps[0]["albedo"])
    for full, substituted in (maps[:2], maps[2:]):
        assert not torch.equal(full["image"], substituted["image"])
        # Nearly as bright: Lambert's law alone would be darker by 3 to 5 %.
        brightness = float(substituted["direct"].sum() / full["direct"].sum())
        assert brightness == pytest.approx(1, abs=0.015)
