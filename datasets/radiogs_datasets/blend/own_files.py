"""Scenes of our own as .blend files and as recipes, from one description: what two renderers are compared on."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..generate.catalogue import recipe
from ..generate.materials import Material, Patterned
from ..generate.patterns import Checker, Point
from ..generate.recipe import Recipe
from ..generate.solids import Box, Solid, Sphere
from .process import Blender


@dataclass(frozen=True)
class Part:
    """A box or sphere, and how Blender copies it; at most one of the three.

    array: count and step of an array modifier. mirror: axis of a mirror modifier, in a plane through the origin.
    instances: places and scales of instances of a collection, in which a sphere is at the origin.
    """

    name: str
    solid: Box | Sphere
    array: tuple[int, Point] | None = None
    mirror: int | None = None
    instances: tuple[tuple[Point, float], ...] = ()

    def solids(self) -> tuple[Solid, ...]:
        """What there is in the world."""
        if self.instances:
            ball = self.solid
            assert isinstance(ball, Sphere)
            return tuple(replace(ball, centre=place, radius=ball.radius * scale) for place, scale in self.instances)
        if self.array is not None:
            count, step = self.array
            return tuple(_moved(self.solid, tuple(number * each for each in step)) for number in range(count))  # type: ignore[arg-type]
        if self.mirror is not None:
            return (self.solid, _mirrored(self.solid, self.mirror))
        return (self.solid,)

    def description(self) -> dict[str, Any]:
        """The part as ``in_blender.authoring`` takes it."""
        solid = self.solid
        said: dict[str, Any] = {"name": self.name, "material": _material(solid.material)}
        if isinstance(solid, Box):
            said |= {"kind": "box", "low": solid.low, "high": solid.high}
        else:
            said |= {"kind": "sphere", "centre": solid.centre, "radius": solid.radius}
        if self.array is not None:
            said["array"] = {"count": self.array[0], "step": self.array[1]}
        if self.mirror is not None:
            said["mirror"] = self.mirror
        if self.instances:
            said["instances"] = self.instances
        return said


def _moved(solid: Box | Sphere, by: Point) -> Solid:
    def move(point: Point) -> Point:
        return tuple(a + b for a, b in zip(point, by, strict=True))  # type: ignore[return-value]

    if isinstance(solid, Box):
        return replace(solid, low=move(solid.low), high=move(solid.high))
    return replace(solid, centre=move(solid.centre))


def _mirrored(solid: Box | Sphere, axis: int) -> Solid:
    def flip(point: Point) -> Point:
        return tuple(-each if place == axis else each for place, each in enumerate(point))  # type: ignore[return-value]

    if isinstance(solid, Sphere):
        return replace(solid, centre=flip(solid.centre))
    low, high = flip(solid.low), flip(solid.high)
    return replace(
        solid,
        low=tuple(map(min, low, high)),  # type: ignore[arg-type]
        high=tuple(map(max, low, high)),  # type: ignore[arg-type]
    )


def _material(finish: Material | Patterned) -> dict[str, Any]:
    if isinstance(finish, Material):
        said = {"albedo": finish.albedo, "roughness": finish.roughness, "specular": finish.specular > 0}
        return said
    pattern = finish.pattern
    assert isinstance(pattern, Checker)
    checker = {"side": pattern.side, "origin": pattern.origin, "second": finish.second.albedo}
    return _material(finish.first) | {"checker": checker}


def _matte(*albedo: float) -> Material:
    red, green, blue = albedo
    return Material((red, green, blue), 1.0, specular=0.0)


WHITE, RED, GREEN, BLUE, GREY = (
    _matte(0.75, 0.75, 0.75), _matte(0.65, 0.07, 0.05), _matte(0.09, 0.5, 0.11), _matte(0.08, 0.16, 0.6),
    _matte(0.45, 0.45, 0.45),
)  # fmt: skip


def _checked(first: Material, second: Material, side: float) -> Patterned:
    return Patterned(first, second, Checker(side, (0.013, 0.027, 0.019)))


FILES: dict[str, tuple[Part, ...]] = {
    "solids": (
        Part("ground", Box((-1.1, -1.1, -0.8), (1.0, 1.0, -0.7), WHITE)),
        Part("red wall", Box((-1.1, -1.0, -0.698), (-1.0, 1.0, 0.6), RED)),
        Part("green wall", Box((-1.1, -1.1, -0.698), (1.0, -1.002, 0.6), GREEN)),
        Part("grey ball", Sphere((-0.35, -0.4, -0.298), 0.4, GREY)),
        Part("blue ball", Sphere((0.3, 0.25, -0.418), 0.28, BLUE)),
    ),
    "checked": (
        Part("ground", Box((-1.0, -1.0, -0.8), (1.0, 1.0, -0.7), _checked(WHITE, RED, 0.27))),
        Part("wall", Box((-1.0, -1.1, -0.698), (1.0, -1.002, 0.6), _checked(GREEN, WHITE, 0.31))),
        Part("ball", Sphere((-0.1, -0.2, -0.25), 0.44, _checked(BLUE, WHITE, 0.23))),
    ),
    "copies": (
        Part("ground", Box((-1.0, -1.0, -0.8), (1.0, 1.0, -0.7), WHITE)),
        Part("steps", Box((-0.9, -0.9, -0.698), (-0.6, 0.1, -0.5), RED), array=(4, (0.31, 0.0, 0.2))),
        Part("pillars", Box((0.62, 0.5, -0.698), (0.85, 0.75, 0.5), GREEN), mirror=0),
        Part(
            "balls", Sphere((0.0, 0.0, 0.0), 0.2, BLUE),
            instances=(((-0.3, 0.55, -0.498), 1.0), ((0.25, 0.5, -0.398), 1.5), ((0.0, 0.2, -0.598), 0.5)),
        ),
    ),
    "dielectric": tuple(
        Part(f"solid {number}", solid)  # type: ignore[arg-type]
        for number, solid in enumerate(recipe("corner").solids)
    ),
}  # fmt: skip
"""Boxes and spheres, a textured scene, one of modifiers and instances: all Lambert. The last has the catalogue's
materials, which Blender's Principled BSDF does not equal: what it shows is the difference of the two BRDFs."""


def write(name: str, folder: Path, blender: Blender) -> Path:
    """Write one of FILES; returns the .blend file."""
    path = folder.absolute() / f"{name}.blend"
    blender.ask("author", description=description(FILES[name]), out=str(path))
    return path


def description(parts: Sequence[Part]) -> dict[str, Any]:
    """What ``in_blender.authoring`` is told."""
    return {"parts": [part.description() for part in parts]}


def as_recipe(name: str) -> Recipe:
    """The same scene for Mitsuba; its rig and lights are those of "corner"."""
    return replace(recipe("corner"), name=name, solids=tuple(each for part in FILES[name] for each in part.solids()))
