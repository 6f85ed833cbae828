"""What a method is given: views with their maps, lights, and how large the scene is."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import torch
from jaxtyping import Float
from torch import Tensor

from ..errors import DataError
from .camera import Camera
from .light import EnvironmentMap
from .surfaces import Surfaces, SurfaceSamples

MapName = Literal["image", "alpha", "albedo", "normal", "roughness", "depth", "direct", "indirect"]
"""Maps of a view, each [height, width, channels], float32:

image      display sRGB in [0, 1], straight (not multiplied by alpha), 3 channels
alpha      coverage in [0, 1], 1 channel
albedo     linear diffuse albedo, straight, 3 channels
normal     unit normals in the world, zero where alpha is zero, 3 channels
roughness  perceptual roughness r (alpha_GGX = r^2), straight, 1 channel
depth      z-depth in world units, zero where alpha is zero, 1 channel
direct     linear outgoing radiance after one surface, multiplied by alpha, 3 channels
indirect   linear outgoing radiance after two or more surfaces, multiplied by alpha, 3 channels

Under another light the names read ``relit/<light>`` (as image) and ``relit/<light>/indirect`` (as indirect).
"""


@dataclass(frozen=True)
class View:
    """One camera and the maps that exist for it; maps are read when asked for."""

    name: str
    camera: Camera
    sources: Mapping[str, Callable[[], Tensor]] = field(repr=False)

    def has(self, name: str) -> bool:
        """Whether the map exists for this view."""
        return name in self.sources

    def read(self, name: str) -> Float[Tensor, "height width channels"]:
        """Read one map (see ``MapName``). Raises DataError if the view lacks it or the file is damaged."""
        if name not in self.sources:
            raise DataError(
                f"view '{self.name}' has no map '{name}'",
                f"It has: {', '.join(sorted(self.sources))}.",
                "Leave out what needs this map, or add the file to the scene.",
            )
        return self.sources[name]()


@dataclass(frozen=True)
class Points:
    """Sparse points of a reconstruction: world positions, and display sRGB colours in [0, 1]."""

    positions: Float[Tensor, "points 3"]
    colours: Float[Tensor, "points 3"]


@dataclass(frozen=True)
class Scene:
    """A captured or synthetic scene, as every layout's loader returns it.

    ``lights`` holds the environment maps for relighting by name; ``training_light`` is the true light of the
    training views, where it is known. ``checksum`` is a digest of every file that the scene consists of. ``repairs``
    says, a sentence each, what the loader had to set right or assume. ``relight`` are views of the object elsewhere,
    each under a light of its own (the map ``relit/<light>`` alone); ``points`` what a reconstruction brought along.
    ``folder`` is where its files are, None for a scene that is computed. ``loaders`` names the modules that read or
    computed it: what they make of the files decides every metric, so their sources are part of a cell's key.
    ``options`` are those that it was opened with, as plain values; empty for a scene taken as it is stored.
    ``surfaces`` samples the true surfaces where they are known, as those of generated scenes are (``true_surfaces``);
    ``surfaces_by`` names the modules that do, whose sources are part of the key of a cell that uses them.
    """

    name: str
    layout: str
    train: tuple[View, ...]
    test: tuple[View, ...]
    lights: Mapping[str, EnvironmentMap]
    training_light: EnvironmentMap | None
    checksum: str
    repairs: tuple[str, ...] = ()
    relight: tuple[View, ...] = ()
    points: Points | None = None
    folder: Path | None = None
    loaders: tuple[str, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    surfaces: Surfaces | None = field(default=None, compare=False, repr=False)
    surfaces_by: tuple[str, ...] = ()

    def true_surfaces(self, spacing: float) -> SurfaceSamples:
        """Samples of the true surfaces, about ``spacing`` world units apart. Raises DataError where none are known."""
        if self.surfaces is None:
            raise DataError(
                f"the surfaces of scene '{self.name}' are not known",
                "Scenes that were generated know theirs; captured ones and other data sets do not.",
            )
        return self.surfaces(spacing)

    @property
    def surrounded(self) -> bool:
        """Whether the images show what surrounds the object as well: no training view has alpha to tell them apart."""
        return not any(view.has("alpha") for view in self.train)

    @property
    def centre(self) -> Float[Tensor, "3"]:
        """The point that the training cameras look at: least squares nearest to their optical axes, in float64."""
        origins = torch.stack([view.camera.centre for view in self.train]).double()
        forward = torch.stack([view.camera.axes[:, 2] for view in self.train]).double()
        projectors = torch.eye(3, dtype=torch.float64) - forward[:, :, None] * forward[:, None, :]
        right = (projectors @ origins[:, :, None]).sum(0)
        # lstsq gives the nearest such point also where all axes are parallel and the system is singular.
        return torch.linalg.lstsq(projectors.sum(0), right, driver="gelsd").solution[:, 0]

    @property
    def extent(self) -> float:
        """The scene's unit of length: 1.1 times the largest distance of a training camera from their mean.

        It is the unit that density control and the position's learning rate use (as in 3DGS).
        """
        origins = torch.stack([view.camera.centre for view in self.train]).double()
        return 1.1 * float((origins - origins.mean(0)).norm(dim=-1).max())
