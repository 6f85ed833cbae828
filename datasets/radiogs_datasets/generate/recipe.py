"""The parts of a scene's recipe: solids with their materials, cameras, lights."""

from dataclasses import dataclass
from typing import Literal

from .patterns import Point
from .solids import Solid


@dataclass(frozen=True)
class Rig:
    """Cameras on a patch of a sphere that looks at ``target``; angles in degrees, azimuth from +X to +Y."""

    target: Point
    radius: float
    azimuth: tuple[float, float]
    elevation: tuple[float, float]
    field_of_view: float = 40.0


TEST_RATIO = 4
"""Samples a pixel of a test view, which is ground truth, over those of a training view: half the noise."""


@dataclass(frozen=True)
class Pictures:
    """How many views of a scene are rendered, of how many pixels a side, and how long the paths of light are.

    ``depth`` counts the light as a vertex: 8 ends at the light after seven surfaces. Deep white basins keep on
    scattering: in ``bowl`` a depth of 8 lacks 6 % of the indirect light, so that it comes with a depth of 32.
    ``samples``: paths a pixel of a training view. Test views have ``TEST_RATIO`` times as many. ``train``: None for the
    number of the recipe.
    """

    size: int = 96
    train: int | None = None
    test: int = 8
    depth: int = 8
    samples: int = 256


@dataclass(frozen=True)
class Recipe:
    """One scene: what stands in it, from where it is seen, and what it is for.

    ``kind``: the scenes that means over kinds take together. ``choices``: whether a method's settings may be chosen by
    results on this scene, or whether these are reported only. ``train``: number of training views.
    """

    name: str
    purpose: str
    solids: tuple[Solid, ...]
    rig: Rig
    training_light: str = "sky"
    relight: tuple[str, ...] = ("sunset", "overcast")
    kind: str = "single effects"
    choices: Literal["tuned on", "reported only"] = "tuned on"
    train: int = 48
