"""Textures of a mesh, for programs that have no surfels: base colour and roughness, from the maps that a model renders.

A mesh of fewer triangles (VTK's quadric decimation) is cut into charts that lie side by side in one image, an atlas
(xatlas). Each texel has a point on the surface, which has the mean of the albedo and roughness that views render there:
views from nearby and straight ahead count most, views that see it at an edge little, and views from which it is hidden
not at all. So the textures are as sharp as the views, however coarse the triangles are, and any method that renders
albedo and roughness has them. Colours by vertex would do for albedo, but glTF and OBJ have no roughness by vertex.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module

import cv2
import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree
from torch import Tensor
from torch.nn.functional import grid_sample

from radiogs_core.contract import Prepared
from radiogs_core.errors import DataError
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.scene import Scene, View

from ..scoring.metrics.surface_distance import pyvista
from .fusion import DepthMap, Lattice
from .mesh import Mesh, pixel_width, rendered

TEXEL_IN_PIXELS = 0.5
"""Width of a texel, as a share of what a pixel covers at the scene's centre: two texels keep an edge that one blurs."""

FILLED = 0.5
"""Share of an atlas that its charts cover, at least: the estimate by which texels are made larger to fit."""

PADDING = 4
"""Texels between charts."""

NEEDED = ("depth", "alpha", "albedo", "roughness")

TEXELS_AT_A_TIME = 1 << 18
"""Bounds temporary memory: about 100 MB."""

SUBTEXEL = 8
"""Bits of OpenCV's fixed-point positions after the point."""


@dataclass(frozen=True)
class Unwrapped:
    """A mesh whose vertices have positions in an image; one at a border of charts is there once for each chart."""

    mesh: Mesh
    normals: Float[np.ndarray, "vertices 3"]
    """Unit, outward."""
    uv: Float[np.ndarray, "vertices 2"]
    """To the right and downwards from the image's upper left corner, in units of its width and height."""
    size: tuple[int, int]
    """Width and height of the image."""


@dataclass(frozen=True)
class Textured:
    """An unwrapped mesh and its textures."""

    shape: Unwrapped
    base_colour: UInt8[np.ndarray, "height width 3"]
    """Albedo in display sRGB."""
    roughness: UInt8[np.ndarray, "height width"]
    """Perceptual (alpha_GGX = r^2), linear: 255 is 1."""
    unseen: float
    """Share of the texels on the surface that no view sees; they have the values of the nearest that one does see."""

    def __str__(self) -> str:
        width, height = self.shape.size
        return f"textures of {width} x {height} texels, {100 * self.unseen:.1f} % of the surface seen by no view"


def reduced(mesh: Mesh, most_faces: int) -> Mesh:
    """Simplify the mesh to at most so many faces, all of positive area. Raises UsageError if VTK lacks libraries."""
    if len(mesh.faces) > most_faces:
        solid = pyvista().PolyData.from_regular_faces(mesh.vertices, mesh.faces)
        fewer = solid.decimate(1 - most_faces / len(mesh.faces))
        mesh = Mesh(np.asarray(fewer.points, np.float64), np.asarray(fewer.regular_faces, np.int64))
    # As files hold them: vertices that differ in float64 only make faces without area and without a normal.
    mesh = Mesh(mesh.vertices.astype(np.float32).astype(np.float64), mesh.faces)
    return Mesh(mesh.vertices, mesh.faces[np.linalg.norm(mesh.face_vectors, axis=-1) > 0])


def texel_of(scene: Scene, mesh: Mesh, most_texels: int) -> float:
    """Width of a texel, world units: see ``TEXEL_IN_PIXELS``; larger where the atlas would exceed ``most_texels``."""
    return max(TEXEL_IN_PIXELS * pixel_width(scene), (mesh.area / FILLED) ** 0.5 / most_texels)


def unwrapped(mesh: Mesh, texel: float) -> Unwrapped:
    """The mesh in an atlas, ``texel`` world units wide each."""
    xatlas = import_module("xatlas")
    atlas, packing = xatlas.Atlas(), xatlas.PackOptions()
    packing.texels_per_unit, packing.padding, packing.bilinear, packing.blockAlign = 1 / texel, PADDING, True, True
    atlas.add_mesh(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
    atlas.generate(pack_options=packing)
    source, faces, uv = atlas[0]
    own = Mesh(mesh.vertices[source], faces.astype(np.int64))
    return Unwrapped(own, mesh.normals[source], uv.astype(np.float64), (atlas.width, atlas.height))


def textured(
    prepared: Prepared,
    views: Sequence[View],
    shape: Unwrapped,
    lattice: Lattice,
    advance: Callable[[int, int], None] = lambda done, total: None,
    *,
    device: torch.device | str = "cpu",
    method: str = "the method",
) -> Textured:
    """Paint a mesh with the albedo and roughness that a model renders of some views.

    ``lattice``: the one that the mesh was made on; a view sees a point if its depth there differs by the truncation at
    most. Raises NotOffered for a model that renders no such maps, DataError where no view sees any of the mesh.
    """
    places = _face_at(shape)
    covered = places >= 0
    points, normals = _surface_at(shape, places, lattice.voxel)
    totals = torch.zeros(len(points), 5)
    for done, (view, maps) in enumerate(rendered(prepared, views, NEEDED, device=device, method=method), 1):
        seen = DepthMap.of(lattice, view.camera, maps["depth"][..., 0], maps["alpha"][..., 0])
        paint = torch.cat([maps[name].float() for name in ("albedo", "roughness", "alpha")], -1)
        for some in torch.arange(len(points)).split(TEXELS_AT_A_TIME):
            _add_view(totals, some, points, normals, seen, paint)
        advance(done, len(views))
    known = (totals[:, 4] > 0).numpy()
    if not known.any():
        raise DataError("no view sees the mesh", "Its surface lies nowhere near their depth maps.", "Use finer voxels.")
    values = totals[:, :4] / totals[:, 4:]
    _, nearest = cKDTree(points[known].numpy()).query(points[~known].numpy())
    values[~known] = values[known][nearest]
    image = np.zeros((*places.shape, 4), np.uint8)
    shown = torch.cat([srgb_encode(values[:, :3].clamp(0, 1)), values[:, 3:]], -1)
    image[covered] = (shown.clamp(0, 1) * 255).round().byte().numpy()
    # Beyond a chart's border lies what is nearest on it: bilinear lookups and smaller copies of the image show no seam.
    rows, columns = distance_transform_edt(~covered, return_distances=False, return_indices=True)
    image = image[rows, columns]
    return Textured(shape, image[..., :3], image[..., 3], float((~known).mean()))


def _face_at(shape: Unwrapped) -> Int[np.ndarray, "height width"]:
    """A face that touches each texel; -1 where none does."""
    width, height = shape.size
    places = np.full((height, width), -1, np.int32)
    corners = (shape.uv * shape.size - 0.5)[shape.mesh.faces] * 2**SUBTEXEL
    for face, corner in enumerate(corners.round().astype(np.int32)):
        cv2.fillConvexPoly(places, corner, face, shift=SUBTEXEL)
    return places


def _surface_at(
    shape: Unwrapped, places: Int[np.ndarray, "height width"], most: float
) -> tuple[Float[Tensor, "texels 3"], Float[Tensor, "texels 3"]]:
    """World points and unit normals at the texels with a face. Texels whose centre lies beside their face lie on its
    plane, ``most`` world units beyond the face's bounding box at most.
    """
    rows, columns = np.nonzero(places >= 0)
    corners = shape.mesh.faces[places[rows, columns]]
    (a, b, c), vertices = np.moveaxis((shape.uv * shape.size)[corners], 1, 0), shape.mesh.vertices[corners]
    first, second, here = b - a, c - a, np.stack([columns, rows], -1) + 0.5 - a
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    flat = area == 0
    area[flat] = 1.0
    s = (here[:, 0] * second[:, 1] - here[:, 1] * second[:, 0]) / area
    t = (first[:, 0] * here[:, 1] - first[:, 1] * here[:, 0]) / area
    weights = np.where(flat[:, None], 1 / 3, np.stack([1 - s - t, s, t], -1))
    points = np.einsum("nk,nkd->nd", weights, vertices)
    points = points.clip(vertices.min(1) - most, vertices.max(1) + most)
    normals = np.cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0])
    return torch.from_numpy(points), torch.from_numpy(normals / np.linalg.norm(normals, axis=-1, keepdims=True))


def _add_view(
    totals: Float[Tensor, "texels 5"],
    some: Int[Tensor, " some"],
    points: Float[Tensor, "texels 3"],
    normals: Float[Tensor, "texels 3"],
    seen: DepthMap,
    paint: Float[Tensor, "height width 5"],
) -> None:
    """Add weight times (albedo, roughness, 1) of one view to some texels; ``paint`` is on black, coverage last."""
    camera = seen.camera
    offset = camera.centre - points[some]
    facing = (offset * normals[some]).sum(-1) / offset.norm(dim=-1)
    pixel, depth, inside = camera.project(points[some])
    chosen = inside & (facing > 0)
    some, pixel, depth, facing = some[chosen], pixel[chosen], depth[chosen], facing[chosen]
    right, down = (pixel[:, 0] - camera.cx) / camera.fx, (pixel[:, 1] - camera.cy) / camera.fy
    inverse, cosine = seen.at(right, down)
    near = (inverse > 0) & ((1 - depth * inverse).abs() <= seen.near * inverse)
    weight = torch.where(near, (cosine * facing * min(camera.fx, camera.fy) / depth).square(), 0.0)
    grid = pixel / pixel.new_tensor([camera.width, camera.height]) * 2 - 1
    values = grid_sample(
        paint.permute(2, 0, 1)[None], grid[None, None].float(), padding_mode="border", align_corners=False
    )[0, :, 0].T
    straight = values[:, :4] / torch.where(values[:, 4:] > 0, values[:, 4:], 1.0)
    totals[some] += weight[:, None].float() * torch.cat([straight, torch.ones_like(straight[:, :1])], -1)
