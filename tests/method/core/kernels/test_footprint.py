"""K5 against SciPy, K10 against dense matrices, K11 against planes that rays meet, K13 against points of the rim.

Raw parameters at once (K11) are compared with the dense matrices, a Cartesian basis, and K11 from a geometry.
"""

import pytest
import torch
from scipy.spatial.transform import Rotation

from radiogs_core.kernels.rasterize.projection import project, project_surfels
from radiogs_core.kernels.surfel.footprint import frames, widened
from radiogs_core.kernels.surfel.geometry import MAX_ALPHA, SplatGeometry
from radiogs_core.kernels.surfel.support import DEGENERATE, FAINT, REGULAR, SATURABLE, support_of
from radiogs_core.scene.camera import Camera
from reference import surfels as dense
from reference.differences import assert_same_with_gradients
from reference.trace import harmonics
from scenes import look_at


def quaternions(count: int = 30) -> torch.Tensor:
    return torch.randn(count, 4, dtype=torch.float64)


def test_frames_are_scipys() -> None:
    rotation = quaternions()
    expected = torch.from_numpy(Rotation.from_quat(rotation.numpy(), scalar_first=True).as_matrix())
    torch.testing.assert_close(frames(rotation), expected, rtol=0, atol=1e-14)


def test_gradients_of_frames_equal_central_differences() -> None:
    assert torch.autograd.gradcheck(frames, (quaternions(8).requires_grad_(),))


def test_a_zero_quaternion_has_neither_frame_nor_gradient() -> None:
    rotation = torch.zeros(2, 4, requires_grad=True)
    found = frames(rotation)
    assert (found == 0).all()
    found.sum().backward()
    assert rotation.grad is not None
    assert (rotation.grad == 0).all()


@pytest.mark.parametrize("length", [1e-37, 1e-20, 1.0, 1e20, 1e38])
def test_the_length_of_a_quaternion_does_not_matter(length: float) -> None:
    rotation = torch.nn.functional.normalize(quaternions(), dim=-1)
    found = frames((length * rotation).float()).double()
    assert (found - frames(rotation)).abs().max() < 1e-6


def test_a_quaternion_that_is_no_number_stays_with_its_surfel() -> None:
    rotation = quaternions()
    rotation[4, 2] = torch.nan
    found = frames(rotation)
    assert torch.isnan(found[4]).any()
    assert torch.isfinite(found[5:]).all()
    assert frames(rotation[:0]).shape == (0, 3, 3)


def camera() -> Camera:
    looking = look_at(torch.tensor([4.0, 0.3, 0.5]), torch.zeros(3), 16, 20.0).to(dtype=torch.float64)
    return Camera(looking.camera_to_world, 20.0, 19.0, 8.3, 6.5, 17, 13)


def surfels(count: int = 30) -> dict[str, torch.Tensor]:
    return {
        "centre": torch.randn(count, 3, dtype=torch.float64),
        "frame": torch.linalg.qr(torch.randn(count, 3, 3, dtype=torch.float64)).Q,
        "scale": 0.01 + 0.3 * torch.rand(count, 2, dtype=torch.float64),
        "opacity": torch.rand(count, dtype=torch.float64),
    }


def ours(*given: torch.Tensor) -> tuple[torch.Tensor, ...]:
    found = widened(camera(), *given)
    return found.axis_u, found.axis_v, found.normal, found.opacity


def theirs(*given: torch.Tensor) -> tuple[torch.Tensor, ...]:
    view = camera()
    return dense.widened(view.centre, view.axes[:, 2], (view.fx + view.fy) / 2, *given)


def test_widened_surfels_and_their_gradients_are_those_of_the_matrices() -> None:
    """The footprint is a constant, so that centres have no gradient."""
    assert_same_with_gradients(ours, theirs, *surfels().values())


@pytest.mark.parametrize("pixel", [(0, 0), (7, 3)])
def test_a_record_says_where_a_pixel_s_ray_meets_the_surfel(pixel: tuple[int, int]) -> None:
    """Depth, u and v by the record, against the intersection with the plane; gradients by both, too."""
    view, given = camera(), surfels()
    column, row = pixel
    along = torch.tensor([(column + 0.5 - view.cx) / view.fx, (row + 0.5 - view.cy) / view.fy, 1], dtype=torch.float64)
    values = {name: value.requires_grad_() for name, value in zip("uvno", ours(*given.values()), strict=True)}
    centre = given["centre"].requires_grad_()
    record = project(view, SplatGeometry(centre, *values.values())).records
    slope = record[:, :3] @ along
    by_record = torch.stack([record[:, 9], record[:, 3:6] @ along, record[:, 6:9] @ along, record[:, 10] * slope], 1)
    ray = view.axes @ along
    towards = centre - view.centre
    depth = (values["n"] * towards).sum(-1) / (values["n"] @ ray)
    offset = depth[:, None] * ray - towards
    beside = torch.stack([depth, (values["u"] * offset).sum(-1), (values["v"] * offset).sum(-1), values["o"]], 1)
    torch.testing.assert_close(by_record / slope[:, None], beside)
    pull = torch.randn_like(beside)
    asked = [centre, *values.values()]
    found = torch.autograd.grad(by_record / slope[:, None], asked, pull)
    expected = torch.autograd.grad(beside, asked, pull)
    for one, other in zip(found, expected, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-8, atol=1e-9)
    support = torch.tensor([dense.support_squared(o) for o in values["o"].tolist()], dtype=torch.float64)
    torch.testing.assert_close(record[:, 11].detach(), support)


def test_the_box_of_a_support_touches_the_points_where_alpha_is_one_grey_level() -> None:
    """Points all along each rim, found from the axes alone; the box is theirs, to the spacing of the points."""
    geometry = widened(camera(), *surfels().values())
    support = support_of(geometry)
    angle = torch.linspace(0, 2 * torch.pi, 20_001, dtype=torch.float64)[:, None]
    for i in torch.nonzero(support.can_be_hit)[:, 0].tolist():
        radius = dense.support_squared(float(geometry.opacity[i])) ** 0.5
        torch.testing.assert_close(float(support.radius[i]), radius)
        axes = torch.stack([geometry.axis_u[i], geometry.axis_v[i]])
        rim = radius * torch.cat([angle.cos(), angle.sin()], 1) @ torch.linalg.pinv(axes).mT
        torch.testing.assert_close(rim.abs().amax(0), support.extent[i], rtol=1e-6, atol=0)


def test_kinds_of_surfels() -> None:
    given = widened(camera(), *surfels(9).values())
    opacities = [0.5, MAX_ALPHA, 0.995, 0.003, 0.5, 0.5, 0.5, torch.nan, torch.inf]
    given.opacity[:] = torch.tensor(opacities, dtype=torch.float64)
    given.centre[4, 1] = torch.inf
    given.axis_u[5] = 0
    given.axis_v[6, 2] = torch.nan
    expected = [REGULAR, REGULAR, SATURABLE, FAINT, *5 * [DEGENERATE]]
    assert support_of(given).kind.tolist() == expected


RAW = ("centre", "rotation", "log_scale", "opacity_logit", "sh")


def raw_surfels(count: int = 60, coefficients: int = 16) -> dict[str, torch.Tensor]:
    given = surfels(count)
    return {
        "centre": given["centre"],
        "rotation": 3 * torch.randn(count, 4, dtype=torch.float64),
        "log_scale": given["scale"].log(),
        "opacity_logit": 2 * torch.randn(count, dtype=torch.float64),
        "sh": 4 * torch.randn(count, coefficients, 3, dtype=torch.float64),
    }


def at_once(given: dict[str, torch.Tensor]) -> tuple[torch.Tensor, ...]:
    centre, rotation, *others = given.values()
    seen = project_surfels(camera(), (centre, rotation), *others)
    assert seen.radiance is not None
    assert seen.sent is not None
    return seen.records, seen.normal, seen.radiance, seen.sent


def one_by_one(given: dict[str, torch.Tensor]) -> tuple[torch.Tensor, ...]:
    """The same by matrices in PyTorch, up to the records, which are K11's."""
    view = camera()
    w, x, y, z = torch.nn.functional.normalize(given["rotation"], dim=-1).unbind(-1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    frame = torch.stack([torch.stack(row, -1) for row in rows], 1)
    focal = (view.fx + view.fy) / 2
    scale, opacity = given["log_scale"].exp(), given["opacity_logit"].sigmoid()
    values = dense.widened(view.centre, view.axes[:, 2], focal, given["centre"], frame, scale, opacity)
    away = torch.nn.functional.normalize(given["centre"] - view.centre, dim=-1)
    seen, still = (
        torch.stack([harmonics(each)[: given["sh"].shape[1]] @ sh for each, sh in zip(along, given["sh"], strict=True)])
        for along in (away, away.detach())
    )
    records = project(view, SplatGeometry(given["centre"], *values)).records
    return records, values[2], (seen + 0.5).clamp(min=0), (still + 0.5).clamp(min=0)


@pytest.mark.parametrize("coefficients", [1, 9, 16])
@pytest.mark.parametrize("pulled", [(0,), (1, 3), (2,), (3,), (0, 1, 2, 3)])
def test_surfels_projected_at_once_and_their_gradients_are_those_of_the_matrices(
    pulled: tuple[int, ...], coefficients: int
) -> None:
    given, gradients = raw_surfels(coefficients=coefficients), []
    expected = one_by_one(given)
    assert 0.1 < float((expected[2] == 0).double().mean()) < 0.9
    pulls = [torch.randn_like(value) for value in expected]
    for of in (at_once, one_by_one):
        leaves = {name: value.clone().requires_grad_() for name, value in given.items()}
        found = of(leaves)
        for one, other in zip(found, expected, strict=True):
            torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-11)
        torch.autograd.backward([found[index] for index in pulled], [pulls[index] for index in pulled])
        gradients.append([torch.zeros_like(leaf) if leaf.grad is None else leaf.grad for leaf in leaves.values()])
    for name, one, other in zip(RAW, *gradients, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-8, atol=1e-10, msg=name)


def test_surfels_projected_at_once_have_the_bounds_of_their_widened_geometry() -> None:
    given, view = raw_surfels(), camera()
    frame = one_by_one(given)[1]
    values = (given["centre"], frames(given["rotation"]), given["log_scale"].exp(), given["opacity_logit"].sigmoid())
    expected = project(view, widened(view, *values)).bounds
    found = project_surfels(view, (given["centre"], given["rotation"]), *(given[name] for name in RAW[2:4]), None)
    assert found.radiance is None
    assert 0.2 < float(expected.touched.double().mean()) < 0.8
    for name in ("tiles", "kind", "touched"):
        assert torch.equal(getattr(found.bounds, name), getattr(expected, name)), name
    torch.testing.assert_close(found.bounds.depth, view.depth_of(given["centre"]))
    torch.testing.assert_close(found.normal, frame)


def test_the_radiance_of_surfels_beside_the_image_may_be_left_out() -> None:
    centre, rotation, *others = raw_surfels().values()
    whole, shown = (project_surfels(camera(), (centre, rotation), *others, only) for only in (False, True))
    touched = shown.bounds.touched[:, None]
    assert whole.radiance is not None
    assert shown.radiance is not None
    assert bool((whole.radiance[~touched[:, 0]] > 0).any())
    assert torch.equal(shown.radiance, torch.where(touched, whole.radiance, 0.0))


def test_surfels_beside_the_image_may_be_left_out_without_radiance() -> None:
    centre, rotation, log_scale, opacity_logit, _ = raw_surfels().values()
    whole, shown = (
        project_surfels(camera(), (centre, rotation), log_scale, opacity_logit, None, only) for only in (False, True)
    )
    assert torch.equal(shown.bounds.tiles, whole.bounds.tiles)
    touched = whole.bounds.touched
    assert 0.2 < float(touched.double().mean()) < 0.8
    assert torch.equal(shown.records[touched], whole.records[touched])
    assert torch.equal(shown.normal, whole.normal)


def values_and_gradients(
    given: list[torch.Tensor], pulls: list[torch.Tensor], shown_only: bool
) -> dict[str, torch.Tensor]:
    """All that surfels are projected to, and their gradients; of what is not shown no record is defined."""
    leaves = [value.clone().requires_grad_() for value in given]
    view = camera().to(dtype=given[0].dtype)
    seen = project_surfels(view, (leaves[0], leaves[1]), *leaves[2:], shown_only)
    found = [seen.records, seen.normal, seen.radiance, seen.sent]
    gradients = torch.autograd.grad(found, leaves, pulls)
    bounds = {name: getattr(seen.bounds, name) for name in ("tiles", "depth", "kind", "touched")}
    values = dict(zip(("records", "normal", "radiance", "sent"), (value.detach() for value in found), strict=True))
    if shown_only:
        values["records"] = torch.where(seen.bounds.touched[:, None], values["records"], 0.0)
    return values | bounds | dict(zip(RAW, gradients, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("shown_only", [False, True])
@pytest.mark.parametrize("coefficients", [1, 4, 9, 16])
def test_a_surfel_is_projected_among_others_as_it_is_alone(coefficients: int, shown_only: bool) -> None:
    """To the last bit, whatever its index among the surfels that are shown and that have gradients."""
    count = 150
    given = [value.float() for value in raw_surfels(count, coefficients).values()]
    pulled = torch.rand(count, 1) < 0.6
    pulls = [torch.randn(count, width) * pulled for width in (12, 3, 3, 3)]
    # Normals are always defined, and what is not shown has no other pull, as in a step.
    away = ~project_surfels(camera().to(dtype=torch.float32), (given[0], given[1]), *given[2:]).bounds.touched
    for pull in pulls:
        pull[away] = 0
    together = values_and_gradients(given, pulls, shown_only)
    assert 0.2 < float((together["centre"] != 0).double().mean()) < 0.6
    for i in range(count):
        alone = values_and_gradients([v[i : i + 1] for v in given], [v[i : i + 1] for v in pulls], shown_only)
        for name, value in alone.items():
            assert torch.equal(value[0], together[name][i]), (name, i)


def test_a_surfel_without_pull_has_no_gradient_whatever_its_numbers() -> None:
    given = [value.float() for value in raw_surfels(40).values()]
    given[0][::3], given[2][1::3] = torch.nan, torch.inf
    pulls = [torch.randn(40, width) for width in (12, 3, 3, 3)]
    for pull in pulls:
        pull[::3], pull[1::3] = 0, 0
    found = values_and_gradients(given, pulls, shown_only=False)
    for name in RAW:
        assert not found[name][::3].any()
        assert not found[name][1::3].any()
        assert bool(found[name][2::3].isfinite().all())
        assert bool(found[name][2::3].any())


def facing_surfels(log_scale: torch.Tensor, opacity_logit: torch.Tensor) -> dict[str, torch.Tensor]:
    """Surfels on a camera's axis that face it, in float32; columns of their frames are axes of the camera."""
    count = len(opacity_logit)
    view = Camera(torch.eye(4), 20.0, 20.0, 8.0, 8.0, 16, 16)
    rotation = torch.tensor([[0.0, 1.0, 0.0, 0.0]]).expand(count, 4)
    centre = torch.tensor([[0.0, 0.0, 3.0]]).expand(count, 3)
    found = {}
    for dtype in (torch.float32, torch.float64):
        place = centre.to(dtype), rotation.to(dtype)
        seen = project_surfels(view.to(dtype=dtype), place, log_scale.to(dtype), opacity_logit.to(dtype), None)
        found[str(dtype)] = seen.records.double()
        found[f"kind {dtype}"] = seen.bounds.kind
    return found


def test_scales_and_opacities_of_any_size_are_exponentials_to_float32_s_last_digits() -> None:
    count, names = 777, (str(torch.float32), str(torch.float64))
    scales = torch.linspace(-40, 40, count)
    sized = facing_surfels(torch.stack([scales, scales + 0.01], 1), torch.full((count,), 3.0))
    strong = facing_surfels(torch.zeros(count, 2), torch.linspace(-80, 80, count))
    for found, columns in ((sized, [3, 7]), (strong, [10])):
        single, double = (found[name][:, columns] for name in names)
        assert bool((double != 0).all())
        assert float((single / double - 1).abs().max()) < 1.5e-6
    # The last has an opacity of one, and what is left of it is the share of each.
    expected = strong[names[1]][-1, 10] * torch.linspace(-80, 80, count).double().sigmoid()
    torch.testing.assert_close(strong[names[1]][:, 10], expected, rtol=1e-13, atol=0)
    drawn = strong["kind torch.float64"] >= REGULAR
    assert 0.1 < float(drawn.double().mean()) < 0.9
    torch.testing.assert_close(*(strong[name][drawn, 11] for name in names), rtol=2e-6, atol=2e-6)


def test_values_out_of_range_become_zero_or_infinite() -> None:
    opacity_logit = torch.tensor([-torch.inf, -1e30, -120.0, 120.0, 1e30, torch.inf, torch.nan, 3.0, 3.0, 3.0, 3.0])
    log_scale = torch.zeros(len(opacity_logit), 2)
    log_scale[7:, 0] = torch.tensor([-torch.inf, -1e30, 1e30, torch.nan])
    found = facing_surfels(log_scale, opacity_logit)
    kinds = [*3 * [FAINT], *3 * [SATURABLE], DEGENERATE, FAINT, FAINT, DEGENERATE, DEGENERATE]
    assert found["kind torch.float32"].tolist() == kinds
    assert found["kind torch.float64"].tolist() == kinds
    assert not found["torch.float32"][:2, 10].any()


def test_surfels_far_beside_the_image_touch_no_tile() -> None:
    """At 1e17 pixels right, left, below and above the image, beyond any 32-bit integer."""
    view = Camera(torch.eye(4), 20.0, 20.0, 8.5, 8.5, 16, 16)
    centre = torch.tensor([[1e8, 0.0, 1e-8], [-1e8, 0.0, 1e-8], [0.0, 1e8, 1e-8], [0.0, -1e8, 1e-8]])
    rotation = torch.tensor([[1.0, 0.0, -1.0, 0.0], [1.0, 0.0, 1.0, 0.0], [1.0, 1.0, 0.0, 0.0], [1.0, -1.0, 0.0, 0.0]])
    seen = project_surfels(view, (centre, rotation), torch.full((4, 2), -25.0), torch.full((4,), 3.0), None)
    assert bool(((seen.normal * centre).sum(-1) < 0).all())
    assert seen.bounds.kind.tolist() == 4 * [REGULAR]
    assert seen.bounds.tiles.tolist() == 4 * [[0, 0, -1, -1]]
