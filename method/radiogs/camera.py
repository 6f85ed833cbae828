"""The pinhole camera: OpenCV axes (x right, y down, z forward), camera-to-world, pixel centres at +0.5."""

from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    ``camera_to_world`` is a rigid 4x4 matrix (world units); ``fx, fy, cx, cy`` are in pixels;
    ``width, height`` count pixels. Pixel (column i, row j) is seen through (i + 0.5, j + 0.5).
    """

    camera_to_world: Float[Tensor, "4 4"]
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    @property
    def centre(self) -> Float[Tensor, "3"]:
        """The centre of projection, in the world."""
        return self.camera_to_world[:3, 3]

    @property
    def axes(self) -> Float[Tensor, "3 3"]:
        """Columns: the camera's right, down and forward axes, in the world."""
        return self.camera_to_world[:3, :3]

    def to(self, device: torch.device | str | None = None, dtype: torch.dtype | None = None) -> "Camera":
        """The same camera with its matrix on another device or of another type."""
        return replace(self, camera_to_world=self.camera_to_world.to(device=device, dtype=dtype))

    def ray_directions(self) -> Float[Tensor, "height width 3"]:
        """World vectors from the centre through each pixel, of unit depth: point = centre + z * direction.

        They are not of unit length; multiply by z-depth to land on the surface.
        """
        like: dict[str, Any] = {"dtype": self.camera_to_world.dtype, "device": self.camera_to_world.device}
        column = (torch.arange(self.width, **like) + 0.5 - self.cx) / self.fx
        row = (torch.arange(self.height, **like) + 0.5 - self.cy) / self.fy
        y, x = torch.meshgrid(row, column, indexing="ij")
        return torch.stack([x, y, torch.ones_like(x)], -1) @ self.axes.T

    def depth_of(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
        """Distance along the forward axis (z-depth), in world units; negative behind the camera."""
        return (points - self.centre) @ self.axes[:, 2]
