"""Cases 18 to 20 and 46: scenes far away, scaled, turned, reordered or behind a wall, and what must not change."""

import math
from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from torch import Tensor

from hard_cases.constructions import (
    assert_near,
    assert_same_bits,
    cast,
    doubled,
    drawn,
    facing,
    looking_along_z,
    moved,
    raw_surfels,
    rays_along_z,
    rendered,
    seen,
    two_balls,
    with_radiance,
)
from radiogs_core.kernels.shade.shade import shade
from radiogs_core.kernels.trace.bvh import SurfelBVH
from radiogs_core.kernels.trace.trace import trace
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.surfels import Surfels
from reference.trace import harmonics
from scenes import look_at

SIDE_VIEW = look_at(torch.tensor([0.5, -5.0, 1.5]), torch.zeros(3), 24, 27.0)


def in_float64(surfels: Surfels) -> Surfels:
    return Surfels.of(doubled(surfels.parameters()))


@pytest.mark.case(18)
@pytest.mark.parametrize(("shift", "quantised"), [(1e2, 2e-4), (1e4, 0.05), (1e6, 0.5)])
def test_a_scene_far_away_errs_only_by_the_rounding_of_its_coordinates(shift: float, quantised: float) -> None:
    """Measured: 1.3e-6 by arithmetic at each of the three; 9e-6, 0.016 and 0.12 by float32's rounding of positions."""
    surfels, camera = two_balls(), SIDE_VIEW
    there = moved(surfels, camera, shift=shift)
    exact = rendered(in_float64(there[0]), there[1].to(dtype=torch.float64))
    found = rendered(*there)
    assert float((found["image"].double() - exact["image"]).abs().max()) < 1e-4
    assert float((found["albedo"].double() - exact["albedo"]).abs().max()) < 1e-4
    assert float((rendered(surfels, camera)["image"].double() - exact["image"]).abs().max()) < quantised


@pytest.mark.case(19)
@pytest.mark.parametrize("scale", [1e-3, 1e3])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_scaled_world_has_the_same_image_and_scaled_depth(scale: float, dtype: torch.dtype) -> None:
    """Visibility, indirect light, shading and splatting. Measured: 1.5e-6 in float32, 3e-15 in float64."""
    surfels, camera = two_balls(dtype), SIDE_VIEW.to(dtype=dtype)
    here, there = rendered(surfels, camera), rendered(*moved(surfels, camera, factor=scale))
    tolerance = 1e-4 if dtype == torch.float32 else 1e-12
    assert float((here["indirect"] > 0.01).double().mean()) > 0.01
    for name, image in here.items():
        unit = scale if name == "depth" else 1.0
        # The normal's length is a share of the image's coverage; where that is an eps its direction is noise.
        known = here["alpha"] > 1e-2
        assert float(((there[name] / unit - image) * known).abs().max()) < tolerance * float(image.abs().max()), name


@pytest.mark.case(19)
@pytest.mark.parametrize("scale", [2.0**-10, 2.0**10])
def test_a_world_scaled_by_a_power_of_two_repeats_bit_for_bit(scale: float) -> None:
    """No constant of the kernels has a unit: there is nothing that could round differently."""
    camera = looking_along_z(20, 15)
    given = with_radiance(facing(2 + torch.rand(30), torch.rand(30), 0.5))
    given["centre"] = given["centre"] + 0.5 * torch.randn(30, 3)
    larger = given | {
        "centre": scale * given["centre"], "axis_u": given["axis_u"] / scale, "axis_v": given["axis_v"] / scale,
    }  # fmt: skip
    for place, (here, there) in enumerate(zip(drawn(camera, given), drawn(camera, larger, scale), strict=True)):
        assert torch.equal(there / (scale if place == 2 else 1), here)
    rays = rays_along_z(50, 0.5)
    for place, (here, there) in enumerate(
        zip(cast(given, rays), cast(larger, rays | {"origin": scale * rays["origin"]}), strict=True)
    ):
        assert torch.equal(there / (scale if place == 3 else 1), here)


def rotated_harmonics(sh: Tensor, rotation: Tensor) -> Tensor:
    """Coefficients of the same radiance in a turned world, by a fit to directions."""
    direction = torch.nn.functional.normalize(torch.randn(200, 3, dtype=torch.float64), dim=-1)
    matrix = torch.linalg.lstsq(harmonics(direction @ rotation.T), harmonics(direction)).solution
    return torch.einsum("ab,nbc->nac", matrix, sh)


@pytest.mark.case(20)
@pytest.mark.parametrize("seed", range(5))
def test_a_rigid_motion_of_everything_changes_nothing(seed: int) -> None:
    """Camera, surfels, harmonics and rays, in float64: to 1e-9, which leaves 1e-4 to the rounding of float32."""
    torch.manual_seed(seed)
    rotation = torch.from_numpy(Rotation.random(random_state=seed).as_matrix())
    shift = torch.randn(3, dtype=torch.float64)
    surfels, camera = raw_surfels(20, torch.float64), looking_along_z(dtype=torch.float64)
    x, y, z, w = Rotation.from_matrix(rotation.numpy()).as_quat()
    turned = []
    for a, b, c, d in surfels.rotation.tolist():
        vx, vy, vz, vw = (Rotation.from_quat([x, y, z, w]) * Rotation.from_quat([b, c, d, a])).as_quat()
        turned.append([vw, vx, vy, vz])
    there = Surfels.of(
        surfels.parameters()
        | {
            "centre": surfels.centre @ rotation.T + shift,
            "rotation": torch.tensor(turned, dtype=torch.float64),
            "sh": rotated_harmonics(surfels.sh, rotation),
        }
    )
    matrix = torch.eye(4, dtype=torch.float64)
    matrix[:3, :3], matrix[:3, 3] = rotation, shift
    elsewhere = replace(camera, camera_to_world=matrix)
    assert_near(seen(elsewhere, there), seen(camera, surfels), 1e-9)
    narrow = Surfels.of({name: value.float() for name, value in there.parameters().items()})
    assert_near(seen(elsewhere.to(dtype=torch.float32), narrow), seen(camera, surfels), 1e-4)
    direction = torch.nn.functional.normalize(torch.randn(40, 3, dtype=torch.float64), dim=-1)
    origin = surfels.centre.repeat(2, 1)
    found = [
        trace(
            SurfelBVH.build(of.geometry()), of.geometry(), of.sh, of.albedo, start, toward,
            torch.full((40,), 0.1, dtype=torch.float64),
        )
        for of, start, toward in (
            (surfels, origin, direction), (there, origin @ rotation.T + shift, direction @ rotation.T),
        )
    ]  # fmt: skip
    assert float((found[0].transmittance < 0.9).double().mean()) > 0.1
    for name in ("radiance", "transmittance", "features", "depth"):
        torch.testing.assert_close(getattr(found[0], name), getattr(found[1], name), rtol=0, atol=1e-9)


@pytest.mark.case(20)
@pytest.mark.parametrize("texels", [1, 5, 16])
def test_turning_the_world_about_its_axis_turns_the_light_with_it(texels: int) -> None:
    """By whole texels, where the turned map is the map itself, moved. Azimuth falls along a row."""
    width = 16
    environment = torch.rand(8, width, 3, dtype=torch.float64)
    angle = 2 * math.pi * texels / width
    rotation = torch.from_numpy(Rotation.from_euler("z", angle).as_matrix())
    unit = torch.nn.functional.normalize(torch.randn(30, 3, dtype=torch.float64), dim=-1)
    towards_light = torch.nn.functional.normalize(unit[:, None] + torch.randn(30, 12, 3, dtype=torch.float64), dim=-1)
    view = torch.nn.functional.normalize(unit + 0.5 * torch.randn(30, 3, dtype=torch.float64), dim=-1)[:, None]
    material = torch.rand(30, 3, dtype=torch.float64), 0.1 + 0.9 * torch.rand(30, dtype=torch.float64)
    one = torch.ones(30, 12, dtype=torch.float64)
    none = torch.zeros(30, 12, 3, dtype=torch.float64)
    here = shade(unit, *material, view, towards_light, one, one, none, environment)
    there = shade(
        unit @ rotation.T, *material, view @ rotation.T, towards_light @ rotation.T, one, one, none,
        environment.roll(-texels, 1),
    )  # fmt: skip
    torch.testing.assert_close(there, here, rtol=1e-9, atol=1e-12)


@pytest.mark.case(46)
def test_a_thousand_surfels_behind_an_opaque_wall_change_no_bit() -> None:
    """Two surfels of 0.99 leave 1e-4, and the third would leave less: the pixel and the ray are full."""
    camera = looking_along_z()
    wall = facing(torch.tensor([2.0, 2.1, 2.2]), 1.0, scale=100.0)
    behind = facing(3 + torch.rand(1000), torch.rand(1000), 1.0)
    both = {name: torch.cat([wall[name], behind[name]]) for name in wall}
    shuffle = torch.randperm(1003)
    mixed = {name: value[shuffle] for name, value in both.items()}
    for each in (both, mixed):
        assert_same_bits(drawn(camera, each), drawn(camera, wall))
    hidden, alone = with_radiance(both, 1), with_radiance(wall, 1)
    alone["sh"] = hidden["sh"][:3]
    rays = rays_along_z(20, 0.3)
    assert_same_bits(cast(hidden, rays), cast(alone, rays))


@pytest.mark.slow
@pytest.mark.case(18)
@pytest.mark.case(19)
@pytest.mark.parametrize(("factor", "shift"), [(1e-3, 0.0), (1e3, 0.0), (1.0, 1e4)])
def test_a_hundred_thousand_surfels_scaled_and_moved(factor: float, shift: float) -> None:
    """The dense reference would take hours: the judge is the float64 kernel, which small scenes check against it."""
    surfels = raw_surfels(100_000, spread=1.5)
    surfels.log_scale = surfels.log_scale - 4
    surfels.opacity_logit = surfels.opacity_logit + 2
    camera = Camera(torch.eye(4), 80.0, 80.0, 32.0, 32.0, 64, 64)
    there = moved(surfels, camera, factor, shift)
    exact = rendered(in_float64(there[0]), there[1].to(dtype=torch.float64), 4)
    found = rendered(*there, samples=4)
    difference = (found["image"].double() - exact["image"]).abs().amax(-1)
    # A hit at the alpha threshold is met in one precision and not in the other: it may change a pixel by 1/255.
    assert float(difference.max()) < 1 / 255
    assert float((difference > 1e-4).double().mean()) < 1e-3


REPEATABLE = settings(derandomize=True, deadline=None, max_examples=12, database=None)


def _scene(seed: int, count: int, spread: float) -> Surfels:
    torch.manual_seed(seed)
    return raw_surfels(count, torch.float64, spread)


def _camera(width: int, height: int, focal: float) -> Camera:
    return Camera(torch.eye(4, dtype=torch.float64), focal, focal, width / 2, height / 3, width, height)


seeds = st.integers(0, 2**31 - 1)
# Surfels at one and the same depth are blended by their number (case 11), so a spread of zero is another matter.
scenes = st.builds(_scene, seed=seeds, count=st.integers(0, 24), spread=st.floats(1e-3, 2))
cameras = st.builds(_camera, width=st.integers(1, 12), height=st.integers(1, 12), focal=st.floats(2, 30))


@pytest.mark.case(19)
@REPEATABLE
@given(scenes, cameras, st.floats(-12, 12))
def test_the_scale_of_the_world_is_seen_in_depth_alone(surfels: Surfels, camera: Camera, power: float) -> None:
    factor = 10.0**power
    larger = Surfels.of(
        surfels.parameters()
        | {
            "centre": factor * surfels.centre,
            "log_scale": surfels.log_scale + torch.tensor(factor, dtype=torch.float64).log(),
        }
    )
    features, alpha, depth = seen(camera, larger)
    assert_near((features, alpha, depth / factor), seen(camera, surfels), 1e-9)


@pytest.mark.case(10)
@REPEATABLE
@given(scenes, cameras)
def test_images_are_bounded_by_what_is_in_them(surfels: Surfels, camera: Camera) -> None:
    """0 <= alpha <= 1 - prod(1 - o), every channel between 0 and the brightest surfel's, whatever is turned away."""
    features, alpha, depth = seen(camera, surfels)
    full = 1 - torch.prod(1 - surfels.opacity.clamp(max=0.99))
    assert float(alpha.min()) >= 0
    assert float(alpha.max()) <= float(full) + 1e-12
    assert bool((depth >= 0).all())
    assert bool((features >= 0).all())
    assert bool((features[..., 3] <= alpha + 1e-12).all()), "roughness is below one"
