"""Relit images against quadrature, and directions drawn from the light in rendering."""

from dataclasses import replace
from functools import cache
from typing import Literal

import pytest
import torch
from torch import Tensor
from torch.nn.functional import normalize

from hard_cases.constructions import joined
from known_ball import CPU, SCENE
from radiogs.model import Model
from radiogs.relighting import RelitByRays, RelitBySurfels, relight
from radiogs.settings import PRESETS, Relighting, Variant
from radiogs.showing import DENSER, Renderer, TrainedRadioGS
from radiogs_core.capabilities import RelitByReference
from radiogs_core.contract import Run
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.learning.solver_rates import SolverRates
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.light import EnvironmentMap, texel_directions, texel_solid_angles
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.tracer import EVERYTHING
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import Box, Solid, Sphere
from reference.quadrature import sphere_quadrature
from reference.shade import shade
from scenes import look_at, surfels_over

F64 = torch.float64
BY_TRACED_LIGHT: tuple[Relighting, ...] = ("bounces", "path")
MetLight = Literal["occluded", "unoccluded"]
CLAY = Material((0.5, 0.35, 0.25), 0.5)
PAINT = Material((0.3, 0.6, 0.7), 0.8)
BALL = Sphere((0.0, 0.0, 0.0), 1.0, CLAY)
TOP, HALF_SIDE = -1.4, 2.0
PLATE = Box((-HALF_SIDE, -HALF_SIDE, TOP - 0.1), (HALF_SIDE, HALF_SIDE, TOP), PAINT)
CAMERA = look_at(torch.tensor([4.0, 0.6, -0.3]), torch.zeros(3), 20, 28.0)
SCALES = [(1.0, 1.0, 1.0), (1.2, 0.7, 0.4)]
BUDGET = replace(PRESETS["smoke"], relight_hemisphere_samples=128, relight_light_samples=32, finetune_iterations=100,
                 relight_bounces=4, relight_paths=256, finetune_surfels=400, finetune_samples=48)  # fmt: skip


def gradient(low: tuple[float, ...], high: tuple[float, ...], towards: tuple[float, ...]) -> EnvironmentMap:
    """A light with a gradient from one colour to another; it has the colour ``high`` in the direction ``towards``."""
    share = (1 + texel_directions(16, 32) @ normalize(torch.tensor(towards, dtype=F64), dim=0)) / 2
    colours = torch.tensor([low, high], dtype=F64)
    return EnvironmentMap((colours[0] + share[..., None].square() * (colours[1] - colours[0])).float())


def constant(*colour: float) -> EnvironmentMap:
    return EnvironmentMap(torch.tensor(colour).expand(8, 16, 3).contiguous())


EVENING = gradient((0.1, 0.15, 0.3), (1.5, 0.8, 0.3), (1.0, 0.5, 0.2))
NOON = gradient((0.1, 0.1, 0.05), (0.4, 0.7, 1.1), (0.2, -0.4, 1.0))
AMBER, TEAL = constant(0.9, 0.5, 0.1), constant(0.1, 0.5, 0.6)


@cache
def model_of(*solids: Solid) -> Model:
    """Surfels over the solids with a grey radiance of 1/2 and a light of 1, unrelated to the lights of the tests."""
    first, *rest = solids
    surfels = surfels_over([first], 0.12)
    for solid in rest:
        surfels = joined(surfels, surfels_over([solid], 0.2))
    return Model(surfels, torch.zeros(8, 16, 3))


def maps(
    model: Model,
    light: EnvironmentMap,
    scale: tuple[float, ...],
    mode: Relighting = "pbr",
    met_light: MetLight = "occluded",
) -> dict[str, Tensor]:
    run = Run(SCENE, Variant(relighting=mode, met_light=met_light), BUDGET, 0, CPU)
    return relight(model, light, torch.tensor(scale), run).render(CAMERA)


@cache
def seen_of_the_ball() -> tuple[Tensor, Tensor, Tensor]:
    """Mask of pixels well inside the silhouette of the ball, their points on it, and their directions to the camera."""
    rays = normalize(CAMERA.ray_directions().double(), dim=-1)
    origin = CAMERA.centre.double()
    along = -(rays @ origin)
    discriminant = along.square() - origin.square().sum() + 1
    inside = discriminant > 0.35
    point = origin + rays[inside] * (along - discriminant.clamp(min=0).sqrt())[inside][:, None]
    return inside, point, -rays[inside]


def under(
    light: EnvironmentMap, scale: tuple[float, ...], over_plate: bool, met_light: MetLight = "occluded"
) -> tuple[Tensor, Tensor]:
    """Direct and indirect radiance, linear RGB, of the pixels of ``seen_of_the_ball``.

    The light on the plate is constant. If the plate is occluded, the ball hides the share cos / distance^2 of the
    plate's light (its form factor), and sends as much diffuse light as the plate itself, bounce by bounce.
    """
    _, normal, outgoing = seen_of_the_ball()
    direction, weight = (each.expand(len(normal), *each.shape) for each in sphere_quadrature(48))
    arrives = torch.zeros_like(direction)
    seen = torch.ones_like(weight)
    if over_plate:
        # Intersection of the ray from the ball's point with the plane of the plate's upper side.
        far = (TOP - normal[:, None, 2]) / direction[..., 2]
        at = normal[:, None] + far[..., None] * direction
        hits = (far > 0) & (at[..., :2].abs() < HALF_SIDE).all(-1)
        seen = (~hits).to(F64)
        hidden = -TOP / at.norm(dim=-1) ** 3 if met_light == "occluded" else torch.zeros_like(far)
        hidden = hidden.clamp(0, 1)[..., None]
        again = hidden * torch.tensor(PAINT.albedo, dtype=F64) * torch.tensor(scale, dtype=F64)
        bounces = torch.stack([again**number for number in range(40)]).sum(0)
        diffuse, specular = sent_by_the_plate(light, scale, -direction[..., 2])
        sent = (1 - hidden) * (bounces * diffuse + specular)
        arrives = torch.where(hits[..., None], sent, 0.0)
    parts = shaded(CLAY, scale, normal, outgoing, direction, weight, seen, arrives, light)
    return parts[:, 0] + parts[:, 2], parts[:, 1] + parts[:, 3]


def sent_by_the_plate(light: EnvironmentMap, scale: tuple[float, ...], cosine: Tensor) -> tuple[Tensor, Tensor]:
    """Diffuse and specular radiance of the plate, unoccluded, under a constant light, by cosine of normal and ray."""
    grid = (torch.arange(32, dtype=F64) + 0.5) / 32
    views = torch.stack([(1 - grid.square()).sqrt(), torch.zeros_like(grid), grid], -1)
    up = torch.tensor([0.0, 0.0, 1.0], dtype=F64).expand_as(views)
    direction, weight = (each.expand(len(grid), *each.shape) for each in sphere_quadrature(96))
    nothing = torch.zeros_like(direction)
    table = shaded(PAINT, scale, up, views, direction, weight, torch.ones_like(weight), nothing, light)
    row = (cosine * 32).long().clamp(0, 31)
    return table[row, 0], table[row, 2]


def shaded(
    material: Material, scale: tuple[float, ...], normal: Tensor, outgoing: Tensor,
    direction: Tensor, weight: Tensor, seen: Tensor, arrives: Tensor, light: EnvironmentMap,
) -> Tensor:  # fmt: skip
    albedo = torch.tensor(material.albedo, dtype=F64) * torch.tensor(scale, dtype=F64)
    rough = torch.full((len(normal),), material.roughness, dtype=F64)
    rows = [
        shade(
            normal[i : i + 1], albedo[None], rough[i : i + 1], outgoing[i : i + 1, None],
            direction[i : i + 1], weight[i : i + 1], seen[i : i + 1], arrives[i : i + 1], light.radiance.double(),
        )[:, 0]
        for i in range(len(normal))
    ]  # fmt: skip
    return torch.cat(rows)


def on_the_ball(found: dict[str, Tensor], name: str) -> Tensor:
    """The values of pixels on the ball, divided by their coverage, because surfels let a little light through."""
    inside, _, _ = seen_of_the_ball()
    return (found[name] / found["alpha"])[inside].double()


def off(found: Tensor, expected: Tensor) -> tuple[float, float]:
    """Largest error of a channel's mean, and largest mean error of the pixels, relative to the true mean."""
    mean = expected.mean(0)
    return float(((found.mean(0) - mean) / mean).abs().max()), float(((found - expected).abs().mean(0) / mean).max())


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("light", [EVENING, NOON], ids=["evening", "noon"])
def test_direct_light_on_a_single_ball_agrees_with_quadrature(light: EnvironmentMap, scale: tuple[float, ...]) -> None:
    found = maps(model_of(BALL), light, scale)
    mean, pixels = off(on_the_ball(found, "direct"), under(light, scale, over_plate=False)[0])
    assert mean < 0.03
    assert pixels < 0.06
    assert float(found["indirect"].max()) < 1e-3


@pytest.mark.parametrize("met_light", ["occluded", "unoccluded"])
@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("light", [AMBER, TEAL], ids=["amber", "teal"])
def test_occlusion_and_indirect_light_of_a_plate_agree_with_quadrature(
    light: EnvironmentMap, scale: tuple[float, ...], met_light: MetLight
) -> None:
    found = maps(model_of(BALL, PLATE), light, scale, met_light=met_light)
    direct, indirect = under(light, scale, over_plate=True, met_light=met_light)
    assert float(indirect.mean()) > 0.05 * float(direct.mean())
    mean, pixels = off(on_the_ball(found, "direct"), direct)
    assert mean < 0.03
    assert pixels < 0.06
    mean, pixels = off(on_the_ball(found, "indirect"), indirect)
    assert mean < 0.08
    assert pixels < 0.15


def test_the_image_is_the_sum_of_direct_and_indirect_light() -> None:
    found = maps(model_of(BALL, PLATE), AMBER, SCALES[0])
    image = srgb_encode(on_the_ball(found, "direct") + on_the_ball(found, "indirect"))
    assert off(on_the_ball(found, "image"), image)[1] < 0.02


def test_relit_images_do_not_depend_on_the_learnt_radiance_and_light() -> None:
    """The result does not depend on the surfels' own radiance or on the recovered light."""
    model = model_of(BALL, PLATE)
    brighter = Surfels.of(model.surfels.parameters() | {"sh": model.surfels.sh + 0.4})
    first, second = (maps(each, AMBER, SCALES[1]) for each in (model, Model(brighter, model.log_environment + 1)))
    for name, value in first.items():
        assert torch.equal(value, second[name]), name


def test_fine_tuning_steps_at_the_rates_of_the_variant() -> None:
    """A single step of Adam is as long as the rate."""
    moved = []
    for rate in (0.0, 0.01):
        variant = Variant(relighting="surfels", finetuning=SolverRates(rate, unit="one"))
        run = Run(SCENE, variant, replace(BUDGET, finetune_iterations=1), 0, CPU)
        found = relight(model_of(BALL), AMBER, torch.ones(3), run)
        assert isinstance(found, RelitBySurfels)
        moved.append(float((found.surfels.sh - model_of(BALL).surfels.sh)[:, 0].abs().max()))
    assert moved == [0.0, pytest.approx(0.01, rel=1e-3)]


def test_traced_bounces_have_the_direct_light_of_the_same_rays() -> None:
    by_split_sum, by_bounces = (maps(model_of(BALL, PLATE), AMBER, SCALES[1], mode) for mode in ("pbr", "bounces"))
    assert torch.equal(by_split_sum["direct"], by_bounces["direct"])
    assert not torch.allclose(by_split_sum["indirect"], by_bounces["indirect"], rtol=0.01)


@pytest.mark.parametrize("scale", SCALES)
def test_traced_bounces_agree_with_path_tracing(scale: tuple[float, ...]) -> None:
    """The ball under a light from the side, which the plate and the ball send to each other."""
    by_bounces, by_paths = (maps(model_of(BALL, PLATE), EVENING, scale, mode) for mode in BY_TRACED_LIGHT)
    mean, pixels = off(on_the_ball(by_bounces, "direct"), on_the_ball(by_paths, "direct"))
    assert mean < 0.02
    assert pixels < 0.04
    mean, pixels = off(on_the_ball(by_bounces, "indirect"), on_the_ball(by_paths, "indirect"))
    assert mean < 0.05
    assert pixels < 0.2


def test_a_plan_without_bounces_and_a_budget_of_one_are_the_same() -> None:
    run = Run(SCENE, Variant(relighting="bounces"), BUDGET, 0, CPU)
    one = replace(run, budget=replace(BUDGET, relight_bounces=1))
    model, scale = model_of(BALL, PLATE), torch.ones(3)
    many, cut, single = (
        relight(model, AMBER, scale, asked, plan=plan).render(CAMERA)["indirect"]
        for asked, plan in ((run, EVERYTHING), (run, EVERYTHING.without("bounces")), (one, EVERYTHING))
    )
    assert torch.equal(cut, single)
    assert float(many.mean()) > 1.02 * float(cut.mean())


def test_the_reference_has_the_number_of_paths_of_the_budget_and_no_floor() -> None:
    variant = Variant(relighting="path", deviations=("hemisphere-floor",))
    found = relight(model_of(BALL), EVENING, torch.ones(3), Run(SCENE, variant, BUDGET, 0, CPU))
    assert isinstance(found, RelitByRays)
    assert found.incident.direction.shape[1] == BUDGET.relight_paths
    height = (found.incident.direction * found.surfels.frame[:, None, :, 2]).sum(-1)[:, : BUDGET.relight_paths // 2]
    assert 0 < float(height.min()) < 0.1


def test_the_reference_of_a_model_is_path_traced_with_other_random_numbers_than_its_mode() -> None:
    run = Run(SCENE, Variant(relighting="path"), BUDGET, 0, CPU)
    trained = TrainedRadioGS(model_of(BALL, PLATE), run)
    assert isinstance(trained, RelitByReference)
    steps: list[None] = []
    reference = trained.reference(EVENING, torch.ones(3), lambda: steps.append(None)).render(CAMERA)["image"]
    own = trained.prepare(EVENING, torch.ones(3)).render(CAMERA)["image"]
    assert steps
    assert not torch.equal(reference, own)
    assert float((reference - own).abs().mean()) < 0.02


@pytest.mark.parametrize(("mode", "tolerance"), [("finetuned", 0.025), ("surfels", 0.05)])
def test_fine_tuned_radiance_agrees_with_the_new_light_and_the_scaled_albedo(
    mode: Relighting, tolerance: float
) -> None:
    """A hundred steps are enough for this tolerance; the surfels' own radiance still has their noise."""
    direct, indirect = under(AMBER, SCALES[1], over_plate=True)
    found = on_the_ball(maps(model_of(BALL, PLATE), AMBER, SCALES[1], mode), "image")
    assert float((found - srgb_encode(direct + indirect)).mean(0).abs().max()) < tolerance


ROWS = 16
SAMPLES = 32
MATTE_BALL = Sphere((0.0, 0.0, 0.0), 1.0, Material((0.7, 0.7, 0.7), 0.9))


def sun() -> torch.Tensor:
    """A sun 45 degrees high and 40 times as bright as the sky, with half its radiance 9 degrees from its middle."""
    middle = torch.tensor([0.5**0.5, 0.0, 0.5**0.5], dtype=torch.float64)
    lobe = (60.0 * (texel_directions(ROWS, 2 * ROWS) @ middle - 1)).exp()
    return (0.5 + 20 * lobe)[..., None].expand(-1, -1, 3).float()


def by_quadrature(normal: torch.Tensor) -> torch.Tensor:
    """Irradiance on unoccluded surfaces, by a sum of the bilinear map over texels eight times as fine."""
    towards = texel_directions(8 * ROWS, 16 * ROWS)
    light = EnvironmentMap(sun().double()).lookup(towards)[..., 0] * texel_solid_angles(8 * ROWS, 16 * ROWS)
    return (normal.double() @ towards.flatten(0, 1).T).clamp(min=0) @ light.flatten()


def by_directions(normal: torch.Tensor, incident: Incident) -> torch.Tensor:
    """Irradiance from a renderer's directions, weights and visibility."""
    light = EnvironmentMap(sun()).lookup(incident.direction)[..., 0]
    cosine = (incident.direction * normal[:, None]).sum(-1).clamp(min=0)
    return (incident.weight * incident.visibility * cosine * light).sum(1).double()


def errors(deviations: tuple[str, ...]) -> tuple[float, float]:
    """Root-mean-square and mean of the relative error of irradiance, on the sunlit side."""
    surfels = surfels_over([MATTE_BALL], 0.12)
    renderer = Renderer(Model(surfels, sun().log()), SAMPLES, Variant(deviations=deviations))
    assert renderer.incident is not None
    normal = surfels.frame[..., 2]
    truth = by_quadrature(normal)
    lit = truth > 0.5 * truth.max()
    relative = (by_directions(normal, renderer.incident) / truth - 1)[lit]
    return float(relative.square().mean().sqrt()), float(relative.mean())


def test_drawn_directions_remove_the_scatter_of_a_suns_irradiance() -> None:
    use_threads(1)
    scatter, bias = errors(())
    assert scatter < 0.04
    assert abs(bias) < 0.005
    assert errors(("spread-views",))[0] > 3 * scatter


def test_two_renderers_of_one_model_have_the_same_directions() -> None:
    model = Model(surfels_over([MATTE_BALL], 0.3), sun().log())
    first, second = (Renderer(model, SAMPLES, Variant()).incident for _ in range(2))
    assert torch.equal(first.direction, second.direction)


@pytest.mark.parametrize("directions", [1, 3])
def test_the_number_of_drawn_directions_equals_that_of_spread_ones(directions: int) -> None:
    model = Model(surfels_over([MATTE_BALL], 0.5), sun().log())
    for deviations, count in (((), 2 * DENSER * directions), (("spread-views",), directions)):
        incident = Renderer(model, directions, Variant(deviations=deviations)).incident
        assert incident.direction.shape[1] == count
