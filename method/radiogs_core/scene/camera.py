"""The pinhole camera: OpenCV axes (x right, y down, z forward), camera-to-world, pixel centres at +0.5."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ..errors import DataError
from ..instruments import fire

RIGID_TOLERANCE = 1e-3
"""Largest deviation of the axes' inner products from orthonormal: it moves a point at the edge of an image of 1000
pixels by half a pixel. Poses in files are rounded to six digits or better; a scaled or sheared matrix deviates by far
more."""

STEEPEST_RAY = 2.0**23
"""Largest slope of a pixel's ray. Beyond it the forward component, 1, is less than half a float32 step of the ray's
length and would be lost."""


@dataclass(frozen=True)
class Camera:
    """A pinhole camera. The centre of pixel (column i, row j) has the image coordinates (i + 0.5, j + 0.5).

    Raises DataError for a lens or a pose that cannot form an image: rendering with it would show nothing.
    """

    camera_to_world: Float[Tensor, "4 4"]
    """Rigid transform from camera axes to the world, world units."""
    fx: float
    """Horizontal focal length, pixels."""
    fy: float
    """Vertical focal length, pixels."""
    cx: float
    """Column of the principal point, pixels from the left edge of the image."""
    cy: float
    """Row of the principal point, pixels from the upper edge of the image."""
    width: int
    """Columns of the image."""
    height: int
    """Rows of the image."""

    def __post_init__(self) -> None:
        if min(self.width, self.height) < 1:
            raise DataError(
                f"a camera has {self.width} x {self.height} pixels",
                "An image has at least one.",
                "Repair the scene's cameras.",
            )
        lens = {"fx": self.fx, "fy": self.fy, "cx": self.cx, "cy": self.cy}
        reach = max(abs(self.cx), abs(self.width - self.cx), abs(self.cy), abs(self.height - self.cy))
        if not all(map(math.isfinite, lens.values())) or not min(self.fx, self.fy) * STEEPEST_RAY > reach:
            fire(blind_lenses=1)
            raise DataError(
                f"a camera's lens is {', '.join(f'{name} = {value:g}' for name, value in lens.items())}",
                "Focal lengths are positive, and all four are finite numbers of pixels.",
                "Repair the scene's cameras.",
            )
        # Cameras are read on the CPU; checking the copy on a GPU again would make the CPU wait for it.
        if self.camera_to_world.device.type == "cpu":
            self._require_rigid()

    def _require_rigid(self) -> None:
        axes = self.axes.double()
        off = float((axes.mT @ axes - torch.eye(3, dtype=torch.float64)).abs().max())
        if not (off <= RIGID_TOLERANCE and bool(torch.isfinite(self.centre).all())):
            fire(bent_poses=1)
            raise DataError(
                f"a camera's pose is not rigid: its axes are {off:.2g} from orthonormal, its centre is"
                f" {[float(value) for value in self.centre]}",
                "Its rays would have wrong directions.",
                "Repair the scene's cameras; scale the scene, not the pose.",
            )

    @cached_property
    def centre(self) -> Float[Tensor, "3"]:
        """The centre of projection, in the world."""
        return self.camera_to_world[:3, 3]

    @cached_property
    def axes(self) -> Float[Tensor, "3 3"]:
        """Columns: the camera's right, down and forward axes, in the world."""
        return self.camera_to_world[:3, :3]

    def to(self, device: torch.device | str | None = None, dtype: torch.dtype | None = None) -> "Camera":
        """A copy of the camera with its matrix on another device or of another type."""
        moved = self.camera_to_world.to(device=device, dtype=dtype)
        return self if moved is self.camera_to_world else replace(self, camera_to_world=moved)

    def ray_directions(self) -> Float[Tensor, "height width 3"]:
        """World vectors from the centre through each pixel, with z-depth 1 (not unit length).

        A pixel of z-depth z shows the point ``centre + z * direction``.
        """
        like: dict[str, Any] = {"dtype": self.camera_to_world.dtype, "device": self.camera_to_world.device}
        column = (torch.arange(self.width, **like) + 0.5 - self.cx) / self.fx
        row = (torch.arange(self.height, **like) + 0.5 - self.cy) / self.fy
        y, x = torch.meshgrid(row, column, indexing="ij")
        return torch.stack([x, y, torch.ones_like(x)], -1) @ self.axes.T

    def project(
        self, points: Float[Tensor, "points 3"]
    ) -> tuple[Float[Tensor, "points 2"], Float[Tensor, " points"], Bool[Tensor, " points"]]:
        """Image coordinates (column, row) of world points, pixel centres at +0.5; their z-depths, world units; and
        whether each lies in the frame."""
        local = (points - self.centre) @ self.axes
        depth, lens = local[:, 2], points.new_tensor([[self.fx, self.fy], [self.cx, self.cy]])
        pixel = local[:, :2] / depth[:, None] * lens[0] + lens[1]
        size = torch.tensor([self.width, self.height], device=points.device)
        return pixel, depth, ((pixel >= 0) & (pixel < size)).all(-1) & (depth > 0)

    def depth_of(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
        """Distance along the forward axis (z-depth), in world units; negative behind the camera."""
        return (points - self.centre) @ self.axes[:, 2]
