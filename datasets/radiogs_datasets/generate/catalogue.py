"""The scenes that can be generated, as data: solids with their materials, cameras, lights.

World units, Z up, everything inside +-1.3. Solids are closed, face outwards, and neither touch nor overlap (a gap
of 2 mm keeps faces from being coplanar); all are dielectric.
"""

from dataclasses import dataclass

from radiogs.errors import UsageError

Colour = tuple[float, float, float]
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Material:
    """Linear diffuse albedo and perceptual roughness (alpha_GGX = r^2)."""

    albedo: Colour
    roughness: float


@dataclass(frozen=True)
class Box:
    """An axis-aligned box between two corners."""

    low: Point
    high: Point
    material: Material


@dataclass(frozen=True)
class Sphere:
    """A sphere."""

    centre: Point
    radius: float
    material: Material


@dataclass(frozen=True)
class Rig:
    """Cameras on a patch of a sphere that looks at ``target``; angles in degrees, azimuth from +X to +Y."""

    target: Point
    radius: float
    azimuth: tuple[float, float]
    elevation: tuple[float, float]
    field_of_view: float = 40.0


@dataclass(frozen=True)
class Recipe:
    """One scene: what stands in it, from where it is seen, and what it is for."""

    name: str
    purpose: str
    solids: tuple[Box | Sphere, ...]
    rig: Rig
    training_light: str
    relight: tuple[str, ...]


WHITE = Material((0.75, 0.75, 0.75), 0.7)
RED = Material((0.65, 0.07, 0.05), 0.8)
GREEN = Material((0.09, 0.5, 0.11), 0.8)
GREY = Material((0.45, 0.45, 0.45), 0.3)
BLUE = Material((0.08, 0.16, 0.6), 0.5)

_RECIPES = (
    Recipe(
        name="corner",
        purpose="strong coloured inter-reflection between a white floor, two walls and two spheres",
        solids=(
            Box((-1.1, -1.1, -0.8), (1.0, 1.0, -0.7), WHITE),
            Box((-1.1, -1.0, -0.698), (-1.0, 1.0, 0.6), RED),
            Box((-1.1, -1.1, -0.698), (1.0, -1.002, 0.6), GREEN),
            Sphere((-0.35, -0.4, -0.298), 0.4, GREY),
            Sphere((0.3, 0.25, -0.418), 0.28, BLUE),
        ),
        rig=Rig(target=(-0.1, -0.1, -0.25), radius=4.6, azimuth=(-5.0, 95.0), elevation=(12.0, 65.0)),
        training_light="sky",
        relight=("sunset", "overcast"),
    ),
    Recipe(
        name="convex",
        purpose="no inter-reflection and no shadow: what concerns only indirect light must not change anything",
        solids=(Sphere((0.0, 0.0, 0.0), 1.0, Material((0.6, 0.35, 0.2), 0.5)),),
        rig=Rig(target=(0.0, 0.0, 0.0), radius=4.2, azimuth=(0.0, 360.0), elevation=(-20.0, 65.0)),
        training_light="sky",
        relight=("sunset", "overcast"),
    ),
)

RECIPES = {recipe.name: recipe for recipe in _RECIPES}


def recipe(name: str) -> Recipe:
    """The recipe of that name. Raises UsageError for an unknown one."""
    if name not in RECIPES:
        raise UsageError(
            f"there is no recipe for a scene '{name}'", "", f"Scenes that can be generated: {', '.join(RECIPES)}."
        )
    return RECIPES[name]
