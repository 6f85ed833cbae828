"""Fusion of depth maps into a truncated signed distance field (Curless and Levoy 1996), as 2DGS makes its meshes.

Each view adds, to the lattice points near the surfaces that it sees, their distance from the surface along the ray, in
units of the truncation and cut at 1: positive in front, negative behind. Points that are further behind than the
truncation are hidden from the view and get nothing from it; nor do points that it sees before an empty background. The
mean over views is zero at the surface. Views are weighted by the cosine at which they see the surface: distances along
oblique rays are too large, unequally so before and behind a curved surface, and noise of the depth counts for more.

2DGS fuses with Open3D. That is 400 MB for one class, so the field is kept here in blocks that exist near surfaces only
(as in Niessner et al. 2013), and its zero level is found by scikit-image's marching cubes.
"""

import itertools
from dataclasses import dataclass

import numpy as np
import pandas as pd
import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.errors import UsageError
from radiogs_core.scene.camera import Camera

SOLID_ALPHA = 0.5
"""Coverage above which a pixel's depth belongs to a surface."""

EDGE = 0.05
"""Weight of a depth at an edge or seen edge-on, where it is as uncertain as neighbouring pixels differ. A surface that
faces the view has the weight 1, an oblique one the cosine."""

PIXELS_AT_A_TIME = 1 << 16
BLOCKS_AT_A_TIME = 1 << 12
"""Bounds on temporary memory: about 100 and 300 MB."""

SIDE = 8
"""Voxels along a block's side."""

BYTES = SIDE**3 * (4 + 4)
"""Bytes of one block: a float32 sum and a float32 weight for each of its voxels."""

REACH = 2**20
"""Blocks are numbered from -REACH to REACH - 1 along each axis; three such numbers fit into 63 bits."""

Places = Int[np.ndarray, "blocks 3"]
"""Whole-number positions of blocks; block b holds the lattice points 8 b to 8 b + 7 along each axis."""

NEAR = np.array(list(itertools.product(range(SIDE), repeat=3)))
"""Lattice points of a block relative to its first one, in the order in which arrays hold them: z fastest."""


class VoxelBlocks:
    """Weighted sums of truncated distances, and sums of their weights, on a lattice.

    It is kept in blocks of 8 x 8 x 8 points that are made when first asked for.

    ``most_bytes`` bounds both arrays together. They are reserved at once, and take memory as blocks are made.
    """

    def __init__(self, most_bytes: int) -> None:
        self.most = max(most_bytes // BYTES, 1)
        self.sums: Float[np.ndarray, "blocks voxels"] = np.zeros((self.most, SIDE**3), np.float32)
        self.weights: Float[np.ndarray, "blocks voxels"] = np.zeros((self.most, SIDE**3), np.float32)
        self.places: Places = np.zeros((0, 3), np.int64)
        self._keys = pd.Index(key_of(self.places))

    def __len__(self) -> int:
        return len(self.places)

    def rows_of(self, places: Places) -> Int[np.ndarray, " blocks"]:
        """Row of each block in the arrays; -1 for a block that was not made."""
        return np.asarray(self._keys.get_indexer(key_of(places)))

    def made(self, places: Places) -> Int[np.ndarray, " blocks"]:
        """Rows of distinct blocks; new blocks are made. Raises UsageError if they would exceed ``most_bytes``."""
        new = places[self.rows_of(places) < 0]
        if len(self) + len(new) > self.most:
            raise UsageError(
                f"the voxels need more than the {self.most * BYTES / 2**30:.3g} GiB that they may take",
                f"{self.most} blocks of {SIDE} x {SIDE} x {SIDE} voxels fit, and the surfaces seen so far need"
                f" {len(self) + len(new)}.",
                "Choose larger voxels (twice the size needs a quarter of the memory), or allow more memory.",
            )
        self.places = np.concatenate([self.places, new])
        self._keys = self._keys.append(pd.Index(key_of(new)))
        return self.rows_of(places)


def key_of(places: Places) -> Int[np.ndarray, " blocks"]:
    """One number for each block. Raises UsageError for one that is too far from the world's origin."""
    if len(places) and (places.min() < -REACH or places.max() >= REACH):
        raise UsageError(
            f"surfaces lie more than {REACH} blocks of voxels from the origin",
            "",
            "Choose larger voxels, or leave out what is far away.",
        )
    shifted = places.astype(np.int64) + REACH
    keys: Int[np.ndarray, " blocks"] = (shifted[:, 0] * 2 * REACH + shifted[:, 1]) * 2 * REACH + shifted[:, 2]
    return keys


def place_of(keys: Int[np.ndarray, " blocks"]) -> Places:
    """The inverse of ``key_of``."""
    rest, z = np.divmod(keys, 2 * REACH)
    x, y = np.divmod(rest, 2 * REACH)
    return np.stack([x, y, z], -1) - REACH


@dataclass(frozen=True)
class Lattice:
    """Where distances are sampled: ``voxel`` and ``truncation`` in world units, ``farthest`` z-depth that is fused."""

    voxel: float
    truncation: float
    farthest: float

    def __post_init__(self) -> None:
        if not 0 < self.voxel < float("inf"):
            raise UsageError(f"voxels of {self.voxel:g} world units", "Their size is above zero.")
        if not self.truncation >= 2 * self.voxel:
            raise UsageError(
                f"the truncation is {self.truncation / self.voxel:g} voxels",
                "Below two, cells at the surface have corners that no view has seen, and the mesh falls apart.",
            )


class Fusion:
    """A field that depth maps are added to, one after the other; the result does not depend on their order."""

    def __init__(self, lattice: Lattice, most_bytes: int) -> None:
        self.lattice = lattice
        self.blocks = VoxelBlocks(most_bytes)

    def add(
        self, camera: Camera, depth: Float[Tensor, "height width"], alpha: Float[Tensor, "height width"] | None = None
    ) -> None:
        """Add one view: z-depth in world units, and coverage (None: surfaces are where depth is above zero).

        Raises UsageError where the field would exceed its memory, and where voxels are too fine for the view's pixels.
        """
        seen = DepthMap.of(self.lattice, camera, depth, alpha)
        rows = self.blocks.made(self._near_surface(seen))
        for some in np.split(rows, range(BLOCKS_AT_A_TIME, len(rows), BLOCKS_AT_A_TIME)):
            self._add_to(some, seen)

    def _near_surface(self, seen: "DepthMap") -> Places:
        """Blocks with lattice points within the truncation of the surface that a view sees."""
        camera, solid = seen.camera, seen.inverse > 0
        rays, depths = camera.ray_directions()[solid], seen.inverse[solid].reciprocal()
        block = SIDE * self.lattice.voxel
        margin = self.lattice.voxel + depths / min(camera.fx, camera.fy) / 2
        if len(margin) and float(margin.max()) > block / 2:
            footprint = float(depths.max()) / min(camera.fx, camera.fy)
            raise UsageError(
                f"voxels of {self.lattice.voxel:.3g} world units are finer than a sixth of a pixel, which is"
                f" {footprint:.3g} wide at its surface",
                "Between pixels nothing is known of the surface.",
                "Choose larger voxels, or leave out what is far away.",
            )
        count = 1 + 2 * int(np.ceil(self.lattice.truncation / (block / 2)))
        along = torch.linspace(-self.lattice.truncation, self.lattice.truncation, count, dtype=torch.float64)
        corners = torch.cartesian_prod(*[torch.tensor([-1.0, 1.0], dtype=torch.float64)] * 3)
        keys = [np.zeros(0, np.int64)]
        for some in torch.arange(len(rays)).split(PIXELS_AT_A_TIME):
            ray = rays[some]
            on_ray = depths[some, None] + along / ray.norm(dim=-1, keepdim=True)
            points = camera.centre + on_ray[..., None] * ray[:, None]
            around = points[:, :, None] + corners * margin[some, None, None, None]
            found: Int[np.ndarray, "points 3"] = (around / block).floor().long().flatten(0, 2).numpy()
            keys.append(np.unique(key_of(found)))
        return place_of(np.unique(np.concatenate(keys)))

    def _add_to(self, rows: Int[np.ndarray, " blocks"], seen: "DepthMap") -> None:
        camera = seen.camera
        lattice = self.blocks.places[rows][:, None] * SIDE + NEAR
        offset = torch.from_numpy(lattice * self.lattice.voxel) - camera.centre
        x, y, z = (offset @ camera.axes).unbind(-1)
        before = z > self.lattice.voxel
        safe = torch.where(before, z, 1.0)
        right, down = x / safe, y / safe
        inverse, cosine = seen.at(right, down)
        known = before & (inverse > 0)
        along = (1 / torch.where(known, inverse, 1.0) - z) * (1 + right.square() + down.square()).sqrt()
        weight = torch.where(known & (along >= -self.lattice.truncation), cosine, 0.0)
        distance = (along / self.lattice.truncation).clamp(max=1)
        self.blocks.sums[rows] += (weight * distance).float().numpy()
        self.blocks.weights[rows] += weight.float().numpy()


@dataclass(frozen=True)
class DepthMap:
    """Inverse z-depth at pixel centres, on the CPU in float64, zero where no surface is.

    ``near`` is how far apart depths of one surface are, world units.

    A plane m . X = 1 in camera axes has the inverse depth m . r along the ray r = (right, down, 1): it is linear in the
    image, so planes are interpolated exactly. The cosine of ray and normal is m . r / (|m| |r|).
    """

    inverse: Float[Tensor, "height width"]
    camera: Camera
    near: float

    @classmethod
    def of(
        cls,
        lattice: Lattice,
        camera: Camera,
        depth: Float[Tensor, "height width"],
        alpha: Float[Tensor, "height width"] | None = None,
    ) -> "DepthMap":
        """The surfaces that are fused of one view: see ``Fusion.add``."""
        depth = depth.detach().cpu().double()
        solid = depth.isfinite() & (depth > 0) & (depth <= lattice.farthest)
        if alpha is not None:
            solid &= alpha.detach().cpu() >= SOLID_ALPHA
        inverse = torch.where(solid, depth.reciprocal(), 0.0)
        return cls(inverse, camera.to("cpu", torch.float64), lattice.truncation)

    def at(
        self, right: Float[Tensor, "*points"], down: Float[Tensor, "*points"]
    ) -> tuple[Float[Tensor, "*points"], Float[Tensor, "*points"]]:
        """Inverse z-depth of the surface along rays of these slopes (zero: nothing), and its weight.

        Between four pixels of one surface it is a plane through what they see, with the cosine of ray and normal as
        weight. Elsewhere it is what the nearest pixel sees, with the weight ``EDGE``.
        """
        fx, fy = self.camera.fx, self.camera.fy
        column, row = fx * right + self.camera.cx - 0.5, fy * down + self.camera.cy - 0.5
        height, width = self.inverse.shape
        inside = (column > -0.5) & (column < width - 0.5) & (row > -0.5) & (row < height - 0.5)
        left, top = column.floor().clamp(0, max(width - 2, 0)), row.floor().clamp(0, max(height - 2, 0))
        across, below = (column - left).clamp(0, 1), (row - top).clamp(0, 1)
        i, j = top.long(), left.long()
        lower, later = (i + 1).clamp(max=height - 1), (j + 1).clamp(max=width - 1)
        a, b, c, d = (self.inverse[place] for place in ((i, j), (i, later), (lower, j), (lower, later)))
        upper, under = torch.lerp(a, b, across), torch.lerp(c, d, across)
        corners = torch.stack([a, b, c, d])
        least, most = corners.amin(0), corners.amax(0)
        # 1/least - 1/most <= near, without dividing by the zero of an empty pixel.
        plane = inside & (least > 0) & (most - least <= self.near * least * most)
        nearest = torch.where(below < 0.5, torch.where(across < 0.5, a, b), torch.where(across < 0.5, c, d))
        inverse = torch.where(plane, torch.lerp(upper, under, below), torch.where(inside, nearest, 0.0))
        mx, my = fx * torch.lerp(b - a, d - c, below), fy * (under - upper)
        length = (mx.square() + my.square() + (inverse - right * mx - down * my).square()).sqrt()
        ray = (1 + right.square() + down.square()).sqrt()
        cosine = inverse / torch.where(plane, length * ray, 1.0)
        return inverse, torch.where(plane, cosine.clamp(min=EDGE), EDGE)
