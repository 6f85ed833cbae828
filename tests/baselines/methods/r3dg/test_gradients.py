"""R3DG's losses in float64 against a dense reference of visibility, light and image, and central differences."""

from dataclasses import replace
from functools import cache

import torch
from torch import Tensor

from baselines.methods.dense import F64, floor, seen, surfels_of
from baselines.methods.irgs.world import DOWN, looking_down, sheet, together
from radiogs_baselines.methods.r3dg.incident import RaySettings, VisibilityTable, arriving, local_radiance
from radiogs_baselines.methods.r3dg.model import Model, before_softplus
from radiogs_baselines.methods.r3dg.settings import LocalLight, MaterialWeights
from radiogs_baselines.methods.r3dg.training import Lit, blended, bounded, image_losses, light_losses, light_surfels
from radiogs_core.kernels.image.display import displayed
from radiogs_core.learning.geometry import GeometryLearning
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.transport.splatting import Splat
from reference.differences import Values, assert_gradients
from reference.images import sobel
from reference.shade import shade
from reference.trace import harmonics, trace

CAMERA = looking_down(1.5, size=4, dtype=F64)
SAMPLES = 24
START = 0.05
RAYS = RaySettings(START, two_sided=False)
LEARNT = ("albedo_logit", "roughness_logit", "raw_environment", "local")
WEIGHTS = MaterialWeights()
GEOMETRY = GeometryLearning()


@cache
def given() -> Values:
    """A floor of two overlapping surfels, sheets above the camera that shadow part of it, and one facing away."""
    torch.manual_seed(3)
    high = [sheet(2.2, DOWN, 0.8, 0.6, dtype=F64), sheet(2.6, DOWN, 2.0, 0.08, dtype=F64)]
    surfels = together(*floor(), *high)
    values = surfels.parameters()
    values["albedo_logit"] = values["albedo_logit"] + torch.randn_like(values["albedo_logit"])
    values["roughness_logit"] = values["roughness_logit"] + torch.randn_like(values["roughness_logit"])
    local = 0.1 * torch.randn(4, 16, 3, dtype=F64)
    local[:, 0] += 0.5
    return values | {"local": local, "raw_environment": before_softplus(0.2 + torch.rand(6, 12, 3, dtype=F64))}


@cache
def table() -> VisibilityTable:
    return VisibilityTable(surfels_of(given()), RAYS, SAMPLES)


@cache
def target() -> tuple[Tensor, Tensor]:
    """An image that differs from the rendered one in every pixel, and its mask."""
    return 0.9 * torch.rand(4, 4, 3, dtype=F64, generator=torch.Generator().manual_seed(1)), torch.ones(4, 4, dtype=F64)


def lit(values: Values, mode: LocalLight = "free") -> tuple[Model, Lit]:
    """Radiance and irradiance of all surfels, as stage 2 computes them."""
    model = Model(bounded(surfels_of(values)), values["local"], values["raw_environment"])
    incident = arriving(table(), model.local, mode)
    return model, light_surfels(CAMERA, model.surfels, incident, model.environment)


def losses(values: Values) -> Tensor:
    """The sum of the losses, as stage 2 computes it."""
    model, light = lit(values)
    drawn = blended(CAMERA, model.surfels, light)
    parts = image_losses(drawn, *target(), WEIGHTS, GEOMETRY)
    return torch.stack([*(parts | light_losses(light.irradiance, model.environment, WEIGHTS)).values()]).sum()


def dense_maps(values: Values, mode: LocalLight) -> dict[str, Tensor]:
    """Radiance and irradiance of the surfels, and the maps of the image, from the formulas."""
    surfels, frame = surfels_of(values), surfels_of(values).geometry()
    albedo = 0.03 + 0.77 / (1 + torch.exp(-values["albedo_logit"]))
    roughness = 0.09 + 0.9 / (1 + torch.exp(-values["roughness_logit"]))
    environment = torch.log1p(torch.exp(values["raw_environment"]))
    direction, weight = table().direction, table().weight
    left = torch.stack([
        trace(
            frame.centre, frame.axis_u, frame.axis_v, frame.normal, frame.opacity, surfels.sh, frame.centre[:, :0],
            origin.expand(SAMPLES, 3), along, torch.full((SAMPLES,), START, dtype=F64), 0.0,
        )[1]
        for origin, along in zip(frame.centre, direction, strict=True)
    ])  # fmt: skip
    visibility = torch.where(left < 0.9, 0.0, left)
    local = torch.einsum("nsk,nkc->nsc", harmonics(direction), values["local"]).clamp(min=0)
    local = local * {"free": 1, "gated": 1 - visibility[..., None], "none": 0}[mode]
    outgoing = torch.nn.functional.normalize(CAMERA.centre - frame.centre, dim=-1)[:, None]
    args = (direction, weight, visibility, local, environment)
    radiance = shade(frame.normal, albedo, roughness, outgoing, *args).sum(2)[:, 0]
    white = shade(frame.normal, torch.ones_like(albedo), roughness, frame.normal[:, None], *args)[:, 0, :2].sum(1)
    features, alpha, _ = seen(CAMERA, surfels, radiance, torch.pi * white, albedo, roughness[:, None])
    names = ("normal", "radiance", "irradiance", "albedo", "roughness")
    maps = dict(zip(names, features.split([3, 3, 3, 3, 1], -1), strict=True))
    del maps["normal"]
    return maps | {"alpha": alpha, "sent": radiance, "received": torch.pi * white}


def maps(values: Values, mode: LocalLight) -> dict[str, Tensor]:
    """The values of ``dense_maps`` as stage 2 computes them."""
    model, light = lit(values, mode)
    drawn = blended(CAMERA, model.surfels, light)
    images = {name: image.flatten(0, 1) for name, image in drawn.images.items()}
    return images | {"alpha": drawn.alpha.flatten(), "sent": light.radiance, "received": light.irradiance}


def total(of: dict[str, Tensor]) -> Tensor:
    """A fixed random combination of all values."""
    generator = torch.Generator().manual_seed(5)
    parts = [(value * torch.rand(value.shape, generator=generator, dtype=F64)).sum() for _, value in sorted(of.items())]
    return torch.stack(parts).sum()


def gradients(value: Tensor, leaves: Values) -> Values:
    found = torch.autograd.grad(value, [leaves[name] for name in LEARNT], allow_unused=True)
    return {name: part for name, part in zip(LEARNT, found, strict=True) if part is not None}


def leaves_of(values: Values) -> Values:
    return {name: value.clone().requires_grad_(name in LEARNT) for name, value in values.items()}


def test_the_table_contains_hidden_open_and_partial_visibility() -> None:
    found = table().visibility[:2].flatten()
    kinds = [(found == 0).sum(), (found == 1).sum(), ((found >= 0.9) & (found < 1)).sum()]
    assert min(int(kind) for kind in kinds) >= 3, "hidden, free, and behind the thin sheet alone"


def test_maps_and_their_gradients_equal_the_formulas() -> None:
    for mode in ("free", "gated", "none"):
        mine, theirs = leaves_of(given()), leaves_of(given())
        found, expected = maps(mine, mode), dense_maps(theirs, mode)
        for name, value in expected.items():
            torch.testing.assert_close(found[name], value, rtol=1e-9, atol=1e-12)
        ours, others = gradients(total(found), mine), gradients(total(expected), theirs)
        assert others.keys() - ours.keys() <= {"local"}
        for name, gradient in ours.items():
            assert gradient.abs().max() > 0, name
            assert (gradient - others[name]).abs().max() < 1e-9 * gradient.abs().max(), name


def kinks(values: Values) -> list[bool]:
    """The branch of every absolute value and clamp of the losses; where it changes there is no derivative."""
    model, light = lit(values)
    drawn = blended(CAMERA, model.surfels, light)
    shown = displayed(drawn.images["radiance"], drawn.alpha)
    slopes = [sobel(displayed(drawn.images[name], drawn.alpha)) for name in ("albedo", "irradiance")]
    signs = [
        local_radiance(model.local, table().direction), shown - target()[0], sobel(drawn.images["roughness"]), *slopes,
        light.irradiance - light.irradiance.mean(-1, keepdim=True),
    ]  # fmt: skip
    return torch.cat([(sign > 0).flatten() for sign in signs]).tolist()  # type: ignore[no-any-return]


def test_gradients_of_the_losses_equal_central_differences() -> None:
    leaves = leaves_of(given())
    found = gradients(losses(leaves), leaves)
    assert set(found) == set(LEARNT)
    torch.manual_seed(0)
    # Harmonics move many slopes at once: longer steps would cross kinks in most directions.
    for step, names in ((1e-4, LEARNT[:3]), (2e-5, LEARNT[3:])):
        some = {name: found[name] for name in names}
        assert_gradients(lambda values: float(losses(values)), given(), some, step, kinks, directions=4)


def test_local_light_has_a_gradient_at_zero_where_it_starts() -> None:
    leaves = leaves_of(given() | {"local": torch.zeros(4, 16, 3, dtype=F64)})
    assert gradients(losses(leaves), leaves)["local"][:2].abs().amax((1, 2)).min() > 0


def test_before_softplus_inverts_softplus_for_faint_and_strong_light() -> None:
    radiance = torch.tensor([1e-12, 1e-3, 0.7, 5.0, 800.0], dtype=F64)
    torch.testing.assert_close(torch.nn.functional.softplus(before_softplus(radiance)), radiance, rtol=1e-9, atol=0)


def test_smoothness_compares_display_values() -> None:
    """Albedo and irradiance are compared as display values of the covered part of pixels."""
    model, light = lit(given())
    drawn = blended(CAMERA, model.surfels, light)
    only = MaterialWeights(**(dict.fromkeys(MaterialWeights.__dataclass_fields__, 0.0) | {"albedo_smoothness": 1.0}))
    flat, mask = torch.full((4, 4, 3), 0.5, dtype=F64), torch.ones(4, 4, dtype=F64)
    alpha = drawn.alpha[..., None]
    shown = srgb_encode(drawn.images["albedo"] / alpha) * alpha
    found = image_losses(drawn, flat, mask, only, GEOMETRY)["albedo smoothness"]
    # On a flat image every slope counts, except beside the border of what is covered: here nothing is.
    torch.testing.assert_close(found, sobel(shown).abs().sum(0).mean(), rtol=1e-9, atol=0)


def test_smoothness_of_irradiance_follows_normal_edges_and_not_image_edges() -> None:
    """An edge of the image does not lower the weight; an edge of the normals does."""
    model, light = lit(given())
    drawn = blended(CAMERA, model.surfels, light)
    none = dict.fromkeys(MaterialWeights.__dataclass_fields__, 0.0)
    only = MaterialWeights(**(none | {"irradiance_smoothness": 1.0}))
    image, mask = target()

    def smoothness(shown: Splat, guide: Tensor) -> Tensor:
        return image_losses(shown, guide, mask, only, GEOMETRY)["irradiance smoothness"]

    found = smoothness(drawn, image)
    torch.testing.assert_close(found, smoothness(drawn, torch.full_like(image, 0.5)), rtol=0, atol=0)
    creased = replace(drawn, normal=drawn.normal * torch.linspace(-3, 3, 4, dtype=F64)[:, None, None])
    assert float(smoothness(creased, image)) < 0.9 * float(found)


def test_irradiance_does_not_depend_on_the_camera() -> None:
    """Seen from below, the floor faces away and has the same irradiance."""
    below = CAMERA.camera_to_world.clone()
    below[2, 3] = -5.0
    model = Model(bounded(surfels_of(given())), given()["local"], given()["raw_environment"])
    incident = arriving(table(), model.local, "free")
    facing, unseen = (
        light_surfels(camera, model.surfels, incident, model.environment)
        for camera in (CAMERA, replace(CAMERA, camera_to_world=below))
    )
    assert float(facing.irradiance[:2].min()) > 0
    assert float(facing.radiance[:2].min()) > 0
    assert float(unseen.radiance[:2].abs().max()) == 0
    torch.testing.assert_close(unseen.irradiance, facing.irradiance)
