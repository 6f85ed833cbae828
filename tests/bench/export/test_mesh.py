"""Meshes from analytic depth maps: where the surface lies, which way it faces, and where it has holes."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import pyvista
import torch
from torch import Tensor

from bench.chain_method import ChainPrepared
from bench.export.depths import all_around, depth_of_box, depth_of_sphere, looking_at_origin
from radiogs_bench.export import mesh as meshing
from radiogs_bench.export.fusion import Fusion, Lattice, VoxelBlocks, key_of, place_of
from radiogs_bench.export.mesh import Mesh, lattice_of, mesh_of, write_mesh, zero_level
from radiogs_core.contract import MapKind, Maps, NotOffered
from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.scene import Scene, View

LATTICE = Lattice(voxel=0.03, truncation=0.12, farthest=10.0)
BUDGET = 1 << 28


def fused(cameras: list[Camera], depths: list[Tensor], lattice: Lattice = LATTICE) -> Mesh:
    fusion = Fusion(lattice, BUDGET)
    for camera, depth in zip(cameras, depths, strict=True):
        fusion.add(camera, depth)
    return zero_level(fusion.blocks, lattice.voxel)


def euler_characteristic(mesh: Mesh) -> int:
    return len(np.unique(mesh.faces)) - len(edges_with_faces(mesh)[0]) + len(mesh.faces)


def edges_with_faces(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Edges, and how many faces have each."""
    ends = np.sort(np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]), -1)
    return np.unique(ends, axis=0, return_counts=True)


@pytest.fixture(scope="module")
def ball() -> Mesh:
    cameras = all_around()
    return fused(cameras, [depth_of_sphere(camera, 1.0) for camera in cameras])


def test_a_sphere_is_found_to_a_fiftieth_of_a_voxel(ball: Mesh) -> None:
    off = (np.linalg.norm(ball.vertices, axis=-1) - 1) / LATTICE.voxel
    assert np.sqrt(np.mean(off**2)) < 0.025
    assert np.abs(off).max() < 0.15
    assert ball.area == pytest.approx(4 * math.pi, rel=1e-3)


def test_a_sphere_is_closed_and_in_one_piece_across_the_cubes_that_it_is_extracted_in(ball: Mesh) -> None:
    assert np.ptp(ball.vertices, axis=0).min() > meshing.CELLS * LATTICE.voxel, "one cube of cells would hold it"
    _, faces = edges_with_faces(ball)
    assert (faces == 2).all()
    assert euler_characteristic(ball) == 2
    assert len(np.unique(ball.faces)) == len(ball.vertices)


def test_faces_and_normals_point_outwards(ball: Mesh) -> None:
    outwards = ball.vertices / np.linalg.norm(ball.vertices, axis=-1, keepdims=True)
    assert ((ball.normals * outwards).sum(-1) > 0.99).all()
    corners = ball.vertices[ball.faces]
    volume = np.linalg.det(corners).sum() / 6
    assert volume == pytest.approx(4 / 3 * math.pi, rel=5e-3)


@pytest.mark.slow
def test_faces_of_a_box_are_flat_and_its_creases_are_where_they_are() -> None:
    low, high = torch.tensor([-0.9, -0.61, -0.5]).double(), torch.tensor([0.77, 0.63, 0.8]).double()
    cameras = all_around()
    mesh = fused(cameras, [depth_of_box(camera, low, high) for camera in cameras])
    beyond = np.maximum(low.numpy() - mesh.vertices, mesh.vertices - high.numpy())
    # The signed distance to a box: outside by the corner that sticks out, inside by the nearest face.
    outside = np.linalg.norm(np.maximum(beyond, 0), axis=-1)
    off = (outside + np.minimum(beyond.max(-1), 0)) / LATTICE.voxel
    near_crease = np.sort(-beyond, axis=-1)[:, 1] < LATTICE.truncation
    assert np.sqrt(np.mean(off[~near_crease] ** 2)) < 0.03
    assert np.abs(off[~near_crease]).max() < 0.1
    # Behind a crease a view sees nothing of the other face: what it takes for hidden may lie outside.
    assert np.sqrt(np.mean(off[near_crease] ** 2)) < 0.4
    assert np.abs(off[near_crease]).max() < 1.5
    assert euler_characteristic(mesh) == 2


def test_surfaces_that_no_view_sees_are_holes() -> None:
    cameras = [looking_at_origin(torch.tensor([0.1, 0.2, 1.0]).double())]
    mesh = fused(cameras, [depth_of_sphere(camera, 1.0) for camera in cameras])
    assert mesh.vertices[:, 2].max() == pytest.approx(1.0, abs=LATTICE.voxel)
    towards = mesh.vertices @ cameras[0].centre.numpy() / 4
    assert towards.min() > 0.0, "a camera at a distance sees less than half of the ball"
    _, faces = edges_with_faces(mesh)
    assert (faces == 1).any()
    assert np.linalg.norm(mesh.vertices, axis=-1) == pytest.approx(np.ones(len(mesh.vertices)), abs=LATTICE.voxel)


def test_uncovered_and_too_distant_pixels_make_no_surface() -> None:
    camera = looking_at_origin(torch.tensor([1.0, 0.0, 0.0]).double())
    depth = depth_of_sphere(camera, 1.0)
    left = torch.arange(depth.shape[1]) < depth.shape[1] // 2
    fusion = Fusion(LATTICE, BUDGET)
    fusion.add(camera, depth, left.double().expand_as(depth))
    whole = fused([camera], [depth])
    half = zero_level(fusion.blocks, LATTICE.voxel)
    right = camera.axes[:, 0].numpy()
    assert (half.vertices @ right).max() < LATTICE.voxel < (whole.vertices @ right).max()
    near = Fusion(Lattice(0.03, 0.12, farthest=2.9), BUDGET)
    near.add(camera, depth)
    assert len(near.blocks) == 0
    with pytest.raises(DataError, match="no surface"):
        zero_level(near.blocks, 0.03)


def test_the_order_of_views_does_not_matter() -> None:
    cameras = all_around(6)
    depths = [depth_of_sphere(camera, 1.0) for camera in cameras]
    there, back = fused(cameras, depths), fused(cameras[::-1], depths[::-1])
    assert there.vertices == pytest.approx(back.vertices, abs=1e-5)
    assert (there.faces == back.faces).all()


def test_memory_is_bounded_and_the_message_names_the_bound() -> None:
    camera = looking_at_origin(torch.tensor([1.0, 0.0, 0.0]).double())
    fusion = Fusion(LATTICE, most_bytes=1 << 16)
    with pytest.raises(UsageError, match=r"than the 6\.1e-05 GiB") as raised:
        fusion.add(camera, depth_of_sphere(camera, 1.0))
    assert "larger voxels" in raised.value.remedy


def test_voxels_that_fall_between_pixels_are_refused() -> None:
    camera = looking_at_origin(torch.tensor([1.0, 0.0, 0.0]).double(), size=16)
    with pytest.raises(UsageError, match="finer than a sixth of a pixel"):
        Fusion(Lattice(0.02, 0.08, 10.0), BUDGET).add(camera, depth_of_sphere(camera, 1.0))


@pytest.mark.parametrize(("voxel", "truncation"), [(0.0, 1.0), (-1.0, 1.0), (math.nan, 1.0), (0.1, 0.15)])
def test_sizes_that_make_no_field_are_refused(voxel: float, truncation: float) -> None:
    with pytest.raises(UsageError):
        Lattice(voxel, truncation, 10.0)


def test_blocks_are_found_again_and_others_are_not() -> None:
    places = np.array([[0, 0, 0], [-1, 5, 3], [7, -100000, 1000000]])
    assert (place_of(key_of(places)) == places).all()
    blocks = VoxelBlocks(1 << 20)
    rows = blocks.made(places[:2])
    assert (blocks.made(places[[1, 2, 0]])[[2, 0]] == rows).all()
    assert (blocks.rows_of(np.array([[1, 1, 1], [-1, 5, 3]])) == [-1, rows[1]]).all()
    with pytest.raises(UsageError, match="from the origin"):
        key_of(np.array([[0, 0, 1 << 20]]))


class Ball:
    """A prepared model that shows a ball of radius 1, whose depth is not among the maps that it renders by default."""

    offers: Mapping[str, MapKind] = dict.fromkeys(("image", "alpha", "depth"), MapKind("data"))
    default = frozenset({"image", "alpha"})
    timed = False

    def render(self, camera: Camera, *further: str) -> Maps:
        depth = depth_of_sphere(camera, 1.0)[..., None].float()
        return {"image": torch.zeros(*depth.shape[:2], 3), "alpha": (depth > 0).float()} | (
            {"depth": depth} if "depth" in further else {}
        )


def views_of_two_sizes() -> Scene:
    wide = [replace(camera, width=200, cx=100.0) for camera in all_around()[::2]]
    views = tuple(View(f"{place}", camera, {}) for place, camera in enumerate([*wide, *all_around()[1::2]]))
    return Scene("ball", "none", views, (), {}, None, "")


def test_any_method_that_renders_depth_has_a_mesh_at_any_size_of_images() -> None:
    scene, told = views_of_two_sizes(), list[tuple[int, int]]()
    mesh = mesh_of(
        Ball(), scene.train, lattice_of(scene, 1 / 150), advance=lambda done, total: told.append((done, total))
    )
    assert np.linalg.norm(mesh.vertices, axis=-1) == pytest.approx(np.ones(len(mesh.vertices)), abs=0.01)
    assert euler_characteristic(mesh) == 2
    assert told[-1] == (len(scene.train), len(scene.train))


def test_voxels_follow_the_extent_unless_pixels_are_coarser() -> None:
    scene = views_of_two_sizes()
    assert lattice_of(scene).voxel == pytest.approx(0.5 * 4 / (1.3 * 160))
    assert lattice_of(scene).farthest == pytest.approx(8.0)
    sharp = [View(view.name, looking_at_origin(view.camera.centre, size=1600), {}) for view in scene.train]
    assert lattice_of(replace(scene, train=tuple(sharp))).voxel == pytest.approx(scene.extent / 512)
    chosen = lattice_of(scene, 0.01, truncation=3.0)
    assert (chosen.voxel, chosen.truncation) == pytest.approx((0.01 * scene.extent, 0.03 * scene.extent))


def test_a_method_without_depth_has_none() -> None:
    scene = views_of_two_sizes()
    with pytest.raises(NotOffered, match="renders no depth"):
        mesh_of(ChainPrepared(0.5), scene.train, lattice_of(scene))


def test_a_written_mesh_is_read_by_others(ball: Mesh, tmp_path: Path) -> None:
    write_mesh(ball, tmp_path / "new" / "ball.ply")
    read = pyvista.read(tmp_path / "new" / "ball.ply")
    assert np.asarray(read.points) == pytest.approx(ball.vertices, abs=1e-6)
    assert (np.asarray(read.faces).reshape(-1, 4)[:, 1:] == ball.faces).all()
    assert np.asarray(read.point_data["Normals"]) == pytest.approx(ball.normals, abs=1e-6)
