import dataclasses

import pytest
import torch

from radiogs_core.errors import DataError
from radiogs_core.scene.colour import srgb_decode
from radiogs_core.scene.scene import View
from radiogs_core.surfels import starting_points
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.surfels.starting_points import (
    Silhouette,
    SurfelStart,
    initial_points,
    initial_surfels,
    neighbour_spacing,
    possible_points,
    view_radius,
)
from scenes import sphere_scene


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_points_fill_the_silhouettes_at_any_scale_of_the_world(scale: float) -> None:
    scene = sphere_scene(views=12, size=32, scale=scale)
    points, colour = initial_points(scene, scene.train, 200, torch.Generator().manual_seed(0), SurfelStart())
    points = points / scale
    assert points.shape == colour.shape == (200, 3)
    horizontal = points[:, :2].norm(dim=-1)
    assert float(horizontal.max()) < 1.25  # a pixel and its neighbour beside the sphere
    assert view_radius(scene) == pytest.approx(scale * 17**0.5 / 1.4 / 2, rel=1e-5)


def test_points_lie_near_the_surface_and_know_its_colour() -> None:
    scene = sphere_scene(views=12, size=48)
    points, colour = initial_points(scene, scene.train, 200, torch.Generator().manual_seed(0), SurfelStart())
    drawn = torch.nn.functional.normalize(torch.randn(200, 3), dim=-1) * torch.rand(200, 1) ** (1 / 3)
    assert float((points.norm(dim=-1) - 1).abs().mean()) < float((drawn.norm(dim=-1) - 1).abs().mean())
    assert float((colour - (points * 0.4 + 0.5)).abs().mean()) < 0.15


def test_surfels_start_grey_anywhere_in_a_box_around_the_origin_whatever_the_silhouettes_are() -> None:
    scene = sphere_scene(views=8, size=16)
    start = SurfelStart(points="box", box=2.0, opacity=0.2)
    surfels = initial_surfels(scene, scene.train, 2_000, start, True, torch.Generator().manual_seed(0))
    assert len(surfels) == 2_000
    inside = surfels.centre.abs().max(-1).values
    assert 1.99 < float(inside.max()) <= 2.0
    assert float((inside < 1.0).double().mean()) == pytest.approx(1 / 8, abs=0.03)
    linear_grey = srgb_decode(torch.tensor(0.5))
    torch.testing.assert_close(surfel_radiance(surfels.sh, surfels.frame[..., 2]), linear_grey.expand(2_000, 3))
    torch.testing.assert_close(surfels.opacity, torch.full((2_000,), 0.2))


def test_contradicting_silhouettes_are_an_error_and_not_an_empty_model() -> None:
    scene = sphere_scene()
    empty = tuple(
        View(view.name, view.camera, {**view.sources, "alpha": lambda: torch.zeros(16, 16, 1)}) for view in scene.train
    )
    broken = dataclasses.replace(scene, train=empty)
    with pytest.raises(DataError, match="silhouettes"):
        initial_points(broken, broken.train, 10, torch.Generator().manual_seed(0), SurfelStart())


def test_spacing_of_a_lattice_is_its_step_and_never_zero() -> None:
    lattice = torch.cartesian_prod(*[torch.arange(4.0)] * 3) * 0.5
    torch.testing.assert_close(neighbour_spacing(lattice), torch.full((64,), 0.5))
    doubled = torch.cat([lattice, lattice, lattice, lattice])
    assert float(neighbour_spacing(torch.cat([doubled, torch.rand(3, 3)])).min()) > 0
    assert neighbour_spacing(torch.zeros(1, 3)).tolist() == [1.0]


def test_candidates_are_drawn_until_enough_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, start = sphere_scene(views=8, size=32), SurfelStart()
    monkeypatch.setattr(starting_points, "DRAWN_AT_ONCE", 500)
    silhouettes, drawn = [Silhouette.of(view) for view in scene.train], [0]
    look = starting_points.inside_all

    def counted(among: list[Silhouette], points: torch.Tensor) -> torch.Tensor:
        drawn[0] += len(points)
        return look(among, points)

    monkeypatch.setattr(starting_points, "inside_all", counted)
    pool = possible_points(scene, silhouettes, 300, torch.Generator().manual_seed(0), start)
    assert len(pool) == 300  # of the 300 * 128 that could be drawn
    assert drawn[0] < 300 * 128 / 2
    careful = dataclasses.replace(start, consistent_share=0.25)
    pool = possible_points(scene, silhouettes, 300, torch.Generator().manual_seed(0), careful)
    assert len(pool) == 1200


def test_a_silhouette_is_the_coverage_and_one_pixel_around_it() -> None:
    view = sphere_scene(size=21).train[0]
    alpha = torch.zeros(21, 21, 1)
    alpha[4, 7] = 1 / 255
    spot = View("spot", view.camera, {**view.sources, "alpha": lambda: alpha})
    row, column = torch.meshgrid(torch.arange(21), torch.arange(21), indexing="ij")
    pixel = torch.stack([column, row], -1).flatten(0, 1) + 0.5
    in_frame, shown = Silhouette.of(spot).shows(pixel, torch.ones(441, dtype=torch.bool))
    assert in_frame.all()
    assert torch.equal(shown.view(21, 21), (row - 4).abs().le(1) & (column - 7).abs().le(1))
    in_frame, shown = Silhouette.of(spot).shows(pixel, torch.zeros(441, dtype=torch.bool))
    assert not (in_frame | shown).any()
