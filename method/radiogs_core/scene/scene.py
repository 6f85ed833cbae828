"""A scene: views with their maps, lights for relighting, and the scene's centre and unit of length."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import torch
from jaxtyping import Float
from torch import Tensor

from ..errors import DataError
from .camera import Camera
from .light import EnvironmentMap
from .surfaces import Surfaces, SurfaceSamples

MapName = Literal["image", "alpha", "valid", "albedo", "normal", "roughness", "depth", "direct", "indirect"]
"""Maps of a view, each [height, width, channels], float32:

image      display sRGB in [0, 1], straight (not multiplied by alpha), 3 channels
alpha      coverage in [0, 1], 1 channel
valid      1 where the photo shows the scene, 0 at pixels that are left out of training and metrics, 1 channel; the
           image is black there
albedo     linear diffuse albedo, straight, 3 channels
normal     unit normals in the world, zero where alpha is zero, 3 channels
roughness  perceptual roughness r (alpha_GGX = r^2), straight, 1 channel
depth      z-depth in world units, zero where alpha is zero, 1 channel
direct     linear outgoing radiance after one surface, multiplied by alpha, 3 channels
indirect   linear outgoing radiance after two or more surfaces, multiplied by alpha, 3 channels

Under another light the names are ``relit/<light>`` (as image) and ``relit/<light>/indirect`` (as indirect).
"""


@dataclass(frozen=True)
class View:
    """One camera and the maps that exist for it; a map is read from its file at each call of ``read``."""

    name: str
    """Name of the view, unique in its scene."""
    camera: Camera
    """Camera of the view."""
    sources: Mapping[str, Callable[[], Tensor]] = field(repr=False)
    """Functions that read the maps, by ``MapName``."""

    def has(self, name: str) -> bool:
        """Whether the map exists for this view."""
        return name in self.sources

    def read(self, name: str) -> Float[Tensor, "height width channels"]:
        """Read one map (see ``MapName``). Raises DataError if the view lacks it or the file is damaged."""
        if name not in self.sources:
            raise DataError(
                f"view '{self.name}' has no map '{name}'",
                f"It has: {', '.join(sorted(self.sources))}.",
                "Leave out the metric that needs this map, or add the file to the scene.",
            )
        return self.sources[name]()


@dataclass(frozen=True)
class Points:
    """Sparse points of a structure-from-motion reconstruction."""

    positions: Float[Tensor, "points 3"]
    """Positions in the world."""
    colours: Float[Tensor, "points 3"]
    """Colours, display sRGB in [0, 1]."""


@dataclass(frozen=True)
class Scene:
    """A captured or synthetic scene, as every layout's loader returns it."""

    name: str
    """Name of the scene."""
    layout: str
    """Name of the layout that its files have."""
    train: tuple[View, ...] = field(repr=False)
    """Training views."""
    test: tuple[View, ...] = field(repr=False)
    """Test views."""
    lights: Mapping[str, EnvironmentMap] = field(repr=False)
    """Environment maps for relighting, by name."""
    training_light: EnvironmentMap | None = field(repr=False)
    """True light of the training views; None if unknown."""
    checksum: str = field(repr=False)
    """Digest of every file of the scene."""
    repairs: tuple[str, ...] = field(default=(), repr=False)
    """Sentences, one for each thing that the loader repaired or assumed."""
    relight: tuple[View, ...] = field(default=(), repr=False)
    """Views of the object in other surroundings, each under a different light (its only map is ``relit/<light>``)."""
    points: Points | None = field(default=None, repr=False)
    """Sparse points of the reconstruction that gave the cameras; None without them."""
    folder: Path | None = None
    """Folder of the files; None for a scene that is computed."""
    loaders: tuple[str, ...] = field(default=(), repr=False)
    """Modules that read or computed the scene. They decide every metric, so their sources are part of a cell's key."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Options that the scene was opened with, as plain values; empty for a scene without changes."""
    surfaces: Surfaces | None = field(default=None, compare=False, repr=False)
    """Samples the true surfaces (see ``true_surfaces``); None if unknown. Generated scenes know them."""
    surfaces_by: tuple[str, ...] = field(default=(), repr=False)
    """Modules that define ``surfaces``. Their sources are part of the key of a cell that uses it."""

    def each_view(self, change: Callable[[View], View]) -> "Scene":
        """The scene with all of its views changed."""
        train, test, relight = (tuple(map(change, views)) for views in (self.train, self.test, self.relight))
        return replace(self, train=train, test=test, relight=relight)

    def true_surfaces(self, spacing: float) -> SurfaceSamples:
        """Samples of the true surfaces, about ``spacing`` world units apart. Raises DataError where none are known."""
        if self.surfaces is None:
            raise DataError(
                f"the surfaces of scene '{self.name}' are not known",
                "Generated scenes know their surfaces; captured scenes and other data sets do not.",
                "Use a generated scene.",
            )
        return self.surfaces(spacing)

    @property
    def surrounded(self) -> bool:
        """Whether the images show the object's surroundings too: no training view has alpha to separate them."""
        return not any(view.has("alpha") for view in self.train)

    @property
    def centre(self) -> Float[Tensor, "3"]:
        """The world point nearest to the optical axes of all training cameras, by least squares; float64."""
        origins = torch.stack([view.camera.centre for view in self.train]).double()
        forward = torch.stack([view.camera.axes[:, 2] for view in self.train]).double()
        projectors = torch.eye(3, dtype=torch.float64) - forward[:, :, None] * forward[:, None, :]
        right = (projectors @ origins[:, :, None]).sum(0)
        # lstsq gives the nearest such point also where all axes are parallel and the system is singular.
        return torch.linalg.lstsq(projectors.sum(0), right, driver="gelsd").solution[:, 0]

    @property
    def extent(self) -> float:
        """The scene's unit of length: 1.1 times the largest distance of a training camera from the cameras' mean.

        Density control and the learning rate of positions use this unit (as in 3DGS). World units.
        """
        origins = torch.stack([view.camera.centre for view in self.train]).double()
        return 1.1 * float((origins - origins.mean(0)).norm(dim=-1).max())
