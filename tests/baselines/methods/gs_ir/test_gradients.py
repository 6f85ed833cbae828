"""GS-IR's losses in float64: a dense reference of the whole shading, and central differences."""

import math
from functools import cache
from itertools import product

import pytest
import torch
from torch import Tensor

from baselines.methods.dense import F64, encode, floor, gradients, seen, surfels_of
from baselines.methods.irgs.world import DOWN, looking_down, sheet, together
from radiogs_baselines.methods.gs_ir.model import Model
from radiogs_baselines.methods.gs_ir.prefilter import filtered_light
from radiogs_baselines.methods.gs_ir.settings import TexelAreas
from radiogs_baselines.methods.gs_ir.shading import View
from radiogs_baselines.methods.gs_ir.training import Reach, bake, image_loss, material_prior, material_smoothness
from radiogs_baselines.methods.gs_ir.volumes import IrradianceVolume, Lattice, OcclusionVolume
from radiogs_bench.lab.kernels import plain
from radiogs_core.learning.losses import environment_smoothness
from radiogs_core.on_surfels.split_sum_light import SplitSumLight
from radiogs_core.transport.prefiltered_light import PrefilteredLight
from reference.differences import Values, assert_gradients
from reference.shade import environment_radiance

CAMERA = looking_down(1.5, size=4, dtype=F64)
LATTICE = Lattice(torch.full((3,), -1.9, dtype=F64), 3.8, 10)
SAMPLES = 12
MATERIALS = ("albedo_logit", "roughness_logit", "metallic_logit")
LEARNT = (*MATERIALS, "environment", "irradiance")
MOVED = (*LEARNT, "centre", "opacity_logit", "log_scale")
"""Geometry parameters compared with the formulas: they act through blending only. Rotations also change the pixels'
footprint, which has no gradient."""
TERMS = ("shaded", "smoothness", "prior", "light smoothness")


@cache
def start() -> Values:
    """A floor of three overlapping surfels, and a sheet outside the camera's view 0.6 above it."""
    torch.manual_seed(3)
    surfels = together(
        *floor(), sheet(0.05, (-0.2, 0.1, 0.97), 0.2, 0.8, dtype=F64), sheet(0.6, DOWN, 0.5, 0.8, dtype=F64)
    )
    given = surfels.parameters()
    for name in ("albedo_logit", "roughness_logit"):
        given[name] = given[name] + 0.3 * torch.randn_like(given[name])
    given["centre"] = given["centre"] + 0.05 * torch.randn_like(given["centre"])
    further = {
        "metallic_logit": 0.5 * torch.randn(4, dtype=F64) - 0.5,
        "environment": 0.2 + torch.rand(6, 12, 3, dtype=F64),
        "irradiance": 0.5 * torch.randn(64, 9, dtype=F64) + torch.eye(9, dtype=F64)[0],
    }
    return given | further


@cache
def occlusion() -> OcclusionVolume:
    return bake(surfels_of(start()), LATTICE, Reach(tau=0.9), 256)


@cache
def target() -> Tensor:
    torch.manual_seed(4)
    return torch.rand(4, 4, 3, dtype=F64)


def model_of(values: Values) -> Model:
    irradiance = IrradianceVolume(LATTICE.of(4), values["irradiance"])
    return Model(surfels_of(values), values["environment"].log(), values["metallic_logit"], occlusion(), irradiance)


def terms(values: Values, areas: TexelAreas = "exact") -> dict[str, Tensor]:
    """The losses as stage 2 computes them, by name."""
    model = model_of(values)
    view = View.of(CAMERA, model, model.surfels.albedo)
    shaded = view.shaded(model, SplitSumLight(filtered_light(model.environment, areas)), SAMPLES)
    maps = torch.cat([view.seen.images[name] for name in ("albedo", "roughness", "metallic")], -1)
    return {
        "shaded": image_loss(view.image(shaded, True), target()),
        "smoothness": material_smoothness(maps, target(), view.seen.alpha.detach() > 0),
        "prior": material_prior(view.points.roughness, view.metallic),
        "light smoothness": environment_smoothness(model.environment),
    }


def harmonics(direction: Tensor, count: int) -> Tensor:
    """Real spherical harmonics in 3DGS's order and signs, from their polynomials."""
    x, y, z = direction.tolist()
    pi = math.pi
    values = [
        0.5 / pi**0.5,
        -((3 / (4 * pi)) ** 0.5) * y, (3 / (4 * pi)) ** 0.5 * z, -((3 / (4 * pi)) ** 0.5) * x,
        (15 / (4 * pi)) ** 0.5 * x * y, -((15 / (4 * pi)) ** 0.5) * y * z,
        (5 / (16 * pi)) ** 0.5 * (3 * z * z - 1),
        -((15 / (4 * pi)) ** 0.5) * x * z, (15 / (16 * pi)) ** 0.5 * (x * x - y * y),
        -((35 / (32 * pi)) ** 0.5) * y * (3 * x * x - y * y), (105 / (4 * pi)) ** 0.5 * x * y * z,
        -((21 / (32 * pi)) ** 0.5) * y * (5 * z * z - 1), (7 / (16 * pi)) ** 0.5 * z * (5 * z * z - 3),
        -((21 / (32 * pi)) ** 0.5) * x * (5 * z * z - 1), (105 / (16 * pi)) ** 0.5 * z * (x * x - y * y),
        -((35 / (32 * pi)) ** 0.5) * x * (x * x - 3 * y * y),
    ]  # fmt: skip
    return torch.tensor(values[:count], dtype=F64)


def corners(position: Tensor, low: float, spacing: float, count: int) -> list[tuple[int, float, Tensor]]:
    """Index, trilinear weight and position of the eight corners around a position in the lattice."""
    found = []
    local = ((position - low) / spacing).clamp(0, count - 1)
    first = local.floor().clamp(max=count - 2).long()
    for step in product((0, 1), repeat=3):
        index = first + torch.tensor(step)
        share = float(torch.prod(1 - (local - index).abs()))
        number = int((index[0] * count + index[1]) * count + index[2])
        found.append((number, share, low + spacing * index.to(F64)))
    return found


def dense_openness(position: Tensor, normal: Tensor) -> float:
    """O by loops: half a cell ahead, only corners in front, the mean of the clamped openness."""
    volume = occlusion()
    middle = position.clamp(-1.9, 1.9) + normal * 3.8 / 10 / 2
    ahead = [each for each in corners(middle, -1.9, 3.8 / 9, 10) if float((each[2] - middle) @ normal) >= 0]
    whole = sum(share for _, share, _ in ahead)
    kept = sum(share / whole * volume.coefficients[volume.probe[number]] for number, share, _ in ahead)
    total = 0.0
    sign = 1.0 if float(normal[2]) >= 0 else -1.0
    lean = -1 / (sign + float(normal[2]))
    x, y = float(normal[0]), float(normal[1])
    first = torch.tensor([1 + sign * x * x * lean, sign * x * y * lean, -sign * x], dtype=F64)
    second = torch.linalg.cross(normal, first)
    for step in range(SAMPLES):
        sine = ((step + 0.5) / SAMPLES) ** 0.5
        turn = step * math.pi * (3 - 5**0.5)
        along = sine * math.cos(turn) * first + sine * math.sin(turn) * second + (1 - sine**2) ** 0.5 * normal
        total += min(1.0, max(0.0, float(kept @ harmonics(along, 16))))  # type: ignore[operator]
    return total / SAMPLES


def dense_image(values: Values) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The image, blended and straight maps of albedo, roughness and metalness, and coverage, from the formulas."""
    surfels = surfels_of(values)
    columns = surfels.albedo, surfels.roughness[:, None], values["metallic_logit"].sigmoid()[:, None]
    features, alpha, depth = seen(CAMERA, surfels, *columns)
    straight, rays = features / alpha[:, None], CAMERA.ray_directions().flatten(0, 1)
    position = (CAMERA.centre + rays * (depth / alpha)[:, None]).detach()
    normal = (features[:, :3] / features[:, :3].norm(dim=-1, keepdim=True)).detach()
    outgoing = -rays / rays.norm(dim=-1, keepdim=True)
    albedo, roughness, metal = straight[:, 3:6], straight[:, 6], straight[:, 7, None]
    light = PrefilteredLight(values["environment"], "height-correlated")
    cosine = (normal * outgoing).sum(-1)
    assert bool((cosine > 0).all())
    mirrored = 2 * cosine[:, None] * normal - outgoing
    scale, bias = plain.brdf_integral(cosine, roughness, light.masking)
    fresnel = 0.04 * (1 - metal) + metal * albedo
    specular = plain.glossy(light, mirrored, roughness) * (fresnel * scale[:, None] + bias[:, None])
    opened = torch.tensor([dense_openness(*each) for each in zip(position, normal, strict=True)], dtype=F64)[:, None]
    arriving = torch.stack([
        sum(share * values["irradiance"][number] for number, share, _ in corners(point, -1.9, 3.8 / 3, 4))
        @ harmonics(facing, 9)
        for point, facing in zip(position, normal, strict=True)
    ]).clamp(min=0)[:, None]  # fmt: skip
    assert 0.2 < float(opened.min()) < float(opened.max()) - 0.05 < 0.9
    assert bool((arriving > 0).any())
    direct_and_indirect = opened * environment_radiance(light.diffuse, normal) + (1 - opened) * arriving
    linear = albedo * direct_and_indirect + specular
    return encode(linear) * alpha[:, None], features[:, 3:], straight[:, 3:], alpha


def dense_terms(values: Values) -> dict[str, Tensor]:
    """The losses from the formulas, pixel by pixel."""
    image, blended, straight, _ = dense_image(values)
    maps, guide = blended.view(4, 4, 5), target()
    down = across = torch.zeros((), dtype=F64)
    for i in range(4):
        for j in range(4):
            if i:
                edge = (-(guide[i, j] - guide[i - 1, j]).abs().mean()).exp()
                down = down + edge * (maps[i, j] - maps[i - 1, j]).square().mean()
            if j:
                edge = (-(guide[i, j] - guide[i, j - 1]).abs().mean()).exp()
                across = across + edge * (maps[i, j] - maps[i, j - 1]).square().mean()
    sky = values["environment"].log()
    around = torch.cat([sky[:, -1:], sky], 1).diff(dim=1)
    return {
        "shaded": (image.clamp(0, 1).view(4, 4, 3) - guide).abs().mean(),
        "smoothness": (down + across) / 12,
        "prior": (1 - straight[:, 3]).mean() + straight[:, 4].mean(),
        "light smoothness": around.square().mean() + sky.diff(dim=0).square().mean(),
    }


REACHED = {
    "shaded": set(MOVED),
    "smoothness": {*MATERIALS, "centre", "opacity_logit", "log_scale"},
    "prior": {"roughness_logit", "metallic_logit", "centre", "opacity_logit", "log_scale"},
    "light smoothness": {"environment"},
}


@pytest.mark.parametrize("term", TERMS)
def test_each_loss_and_its_gradients_equal_the_formulas(term: str) -> None:
    """Geometry has gradients only through the blending: normals and positions have none."""
    torch.testing.assert_close(terms(start())[term], dense_terms(start())[term], rtol=1e-7, atol=0)
    ours, theirs = (gradients(lambda values, of=of: of(values)[term], start(), MOVED) for of in (terms, dense_terms))
    reached = {name for name, value in ours.items() if value.any()}
    assert reached == {name for name, value in theirs.items() if value.any()} == REACHED[term]
    for name in reached:
        assert float((ours[name] - theirs[name]).abs().max()) < 1e-6 * float(theirs[name].abs().max()), name


@pytest.mark.slow
@pytest.mark.parametrize("areas", ["exact", "approximate"])
@pytest.mark.parametrize("term", TERMS)
def test_gradients_equal_central_differences(term: str, areas: TexelAreas) -> None:
    """Materials, light and irradiance. (Moving geometry would move positions and normals, which have no gradient.)"""
    names = tuple(name for name in LEARNT if name in REACHED[term])
    found = gradients(lambda values: terms(values, areas)[term], start(), names)
    assert set(found) == set(names)
    assert_gradients(lambda values: float(terms(values, areas)[term]), start(), found, 1e-4, directions=4)


def test_clipped_pixels_have_no_gradient() -> None:
    image = torch.tensor([[[3.0, 0.5, 0.5]]], dtype=F64, requires_grad=True)
    loss = image_loss(image, torch.tensor([[[0.2, 1.0, 0.2]]], dtype=F64))
    loss.backward()
    assert float(loss.detach()) == pytest.approx((0.8 + 0.5 + 0.3) / 3)
    assert image.grad is not None
    assert (image.grad[0, 0].sign() == torch.tensor([0.0, -1.0, 1.0])).all()


def test_smoothness_counts_only_pairs_of_covered_pixels() -> None:
    """One pair of two is covered, and one channel of five differs; an image edge lowers the weight."""
    maps = torch.tensor([[[0.0], [0.4], [9.0]]], dtype=F64)
    covered = torch.tensor([[True, True, False]])
    flat = torch.zeros(1, 3, 3, dtype=F64)
    assert float(material_smoothness(maps, flat, covered)) == pytest.approx(0.4**2 / 2 / 5)
    edge = flat.clone()
    edge[0, 1] = torch.tensor([0.3, 0.6, 0.9])
    assert float(material_smoothness(maps, edge, covered)) == pytest.approx(math.exp(-0.6) * 0.4**2 / 2 / 5)
