"""Blender Cycles against Mitsuba: .blend files of this script rendered by both, pass by pass.

    pip install "radiogs-bench[generate,blend]"
    python docs/examples/cycles_against_mitsuba.py [--size N] [--samples N] [FILE ...]

Prints a Markdown table: for each pass PSNR between the renderers in dB, in brackets the PSNR that two renderers without
a difference would have at the noise of both (two seeds of each tell it), and the relative difference of sums. The files
are made from one description, as .blend files and as recipes.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radiogs_datasets.blend.cameras import shots
from radiogs_datasets.blend.passes import Maps
from radiogs_datasets.blend.process import Blender, blender_python, require_blender
from radiogs_datasets.blend.request import Request
from radiogs_datasets.blend.studio import Studio, refined
from radiogs_datasets.generate.catalogue import CORNER
from radiogs_datasets.generate.environments import LIGHTS
from radiogs_datasets.generate.materials import Material, Patterned
from radiogs_datasets.generate.patterns import Checker, Point
from radiogs_datasets.generate.probe import require_mitsuba
from radiogs_datasets.generate.recipe import Pinhole, Recipe
from radiogs_datasets.generate.solids import Box, Solid, Sphere
from radiogs_datasets.image_files import read_hdr, write_exr, write_hdr

BOUNCES = 6
"""Seven surfaces before the light: what Mitsuba calls a depth of 8."""

COMPARED = ("alpha", "image", "direct", "indirect", "albedo", "normal", "depth")
FINE = 32
"""Exact hits along a pixel's side: they have no noise of their own."""

TEXEL = (3, 5)
"""Row and column of the one bright texel of a map of 16 x 32."""

Pictures = dict[str, NDArray[np.float64]]


@dataclass(frozen=True)
class Line:
    """One pass of one file: PSNR between the renderers and as expected from their noise, dB; relative bias."""

    file: str
    light: str
    name: str
    measured: float
    expected: float
    bias: float


def texel() -> NDArray[np.float32]:
    """A dim map with one bright texel: what it lights tells how each renderer turns a map."""
    light = np.full((16, 32, 3), 0.02, np.float32)
    light[TEXEL] = (60.0, 50.0, 40.0)
    return light


def compared(names: list[str], size: int, samples: int, view: int = 3) -> Iterator[Line | str]:
    """Lines of the table, and a sentence for the seconds of each file."""
    from radiogs_datasets.generate import render

    render.start()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        for name in names:
            for light, values in {"sky": LIGHTS["sky"].radiance(), "texel": texel()}.items():
                lights = folder / f"{name}-{light}"
                lights.mkdir()
                write_hdr(lights / "training.hdr", values)
                file = write_file(FILES[name], folder / f"{name}.blend")
                request = Request(file, lights, size=size, samples=samples, bounces=BOUNCES)
                with Blender(folder / "blender.log") as blender:
                    cycles, camera, seconds = _cycles(blender, request, view)
                scene = render.build(own_recipe(name), read_hdr(lights / "training.hdr"))
                mitsuba = [_mitsuba(scene, camera, samples, seed) for seed in (1, 2)]
                yield from _lines(name, light, cycles, mitsuba)
                yield f"{name}, {light}: {seconds:.1f} s a picture by Cycles, all passes, {size}^2, {samples} samples"


def _cycles(blender: Blender, request: Request, view: int) -> tuple[list[Pictures], Pinhole, float]:
    """Two pictures of one view by different seeds, its camera, and the seconds of the second."""
    opened = blender.ask("open", file=str(request.file), device="cpu", threads=1)
    shot = shots(request, opened["low"], opened["high"])[view]
    light = request.lights / "as_blender_reads_it.exr"
    write_exr(light, refined(read_hdr(request.lights / "training.hdr")))
    studio = Studio(blender, request, {"training": light}, request.lights / "picture.exr")
    first = studio.take(shot)
    begun = time.perf_counter()
    second = studio.take(shot, other_seed=True)
    seconds = time.perf_counter() - begun
    camera = Pinhole(np.array(shot.opengl()), math.degrees(shot.field_of_view), request.size)
    return [_pictures(first), _pictures(second)], camera, seconds


def _pictures(maps: Maps) -> Pictures:
    light = {name: getattr(maps, name) for name in ("alpha", "image", "direct", "indirect")}
    straight = {name: getattr(maps, name) * maps.alpha for name in ("albedo", "normal", "depth")}
    return {name: value.astype(np.float64) for name, value in {**light, **straight}.items()}


def _mitsuba(scene: object, camera: Pinhole, samples: int, seed: int) -> Pictures:
    from radiogs_datasets.generate import render

    full, direct = (
        render.radiance(scene, camera, samples, depth, seed) for depth in (BOUNCES + 2, render.DIRECT_DEPTH)
    )
    seen = render.surface(scene, camera, FINE)
    alpha = full[..., 3:]
    found = {
        "alpha": alpha, "image": full[..., :3], "direct": direct[..., :3], "indirect": (full - direct)[..., :3],
        "albedo": seen.albedo * alpha, "normal": seen.normal * alpha, "depth": seen.depth * alpha,
    }  # fmt: skip
    return {name: value.astype(np.float64) for name, value in found.items()}


def _lines(file: str, light: str, cycles: list[Pictures], mitsuba: list[Pictures]) -> Iterator[Line]:
    for name in COMPARED:
        first, second = ((pair[0][name] + pair[1][name]) / 2 for pair in (cycles, mitsuba))
        # Half the squared difference of two seeds is the variance of one; a mean of two has half of that.
        noise = sum(np.square(pair[0][name] - pair[1][name]).mean() / 4 for pair in (cycles, mitsuba))
        total = float(np.abs(second).sum())
        bias = float((first - second).sum()) / total if total else 0.0
        yield Line(file, light, name, _db(float(np.square(first - second).mean())), _db(float(noise)), bias)


def _db(error: float) -> float:
    return -10 * math.log10(error) if error else math.inf


@dataclass(frozen=True)
class Part:
    """A box or sphere, and how Blender copies it: by at most one of an array, a mirror and instances."""

    name: str
    """Name of the object."""
    solid: Box | Sphere
    """The solid; a sphere at the origin if it has instances."""
    array: tuple[int, Point] | None = None
    """Count and step of an array modifier."""
    mirror: int | None = None
    """Axis of a mirror modifier, whose plane passes through the origin."""
    instances: tuple[tuple[Point, float], ...] = ()
    """Positions and scales of instances of a collection."""

    def solids(self) -> tuple[Solid, ...]:
        """The solids of the scene."""
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
        """The part as ``solids_in_blender`` takes it."""
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
        for number, solid in enumerate(CORNER.solids)
    ),
}  # fmt: skip
"""Boxes and spheres, a textured scene, one of modifiers and instances: all Lambert. The last has the miniatures'
materials, which Blender's Principled BSDF does not equal: what it shows is the difference of the two BRDFs."""


def write_file(parts: Sequence[Part], path: Path) -> Path:
    """Write parts as a .blend file, in a process that has Blender; returns the file."""
    command = [blender_python(), str(Path(__file__).with_name("solids_in_blender.py")), str(path.absolute())]
    described = json.dumps([part.description() for part in parts])
    subprocess.run(command, input=described, text=True, capture_output=True, check=True)
    return path


def own_recipe(name: str) -> Recipe:
    """The same scene for Mitsuba; its rig and lights are those of "corner"."""
    return replace(CORNER, name=name, solids=tuple(each for part in FILES[name] for each in part.solids()))


def run() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description="Render solids by Blender Cycles and by Mitsuba, and compare.")
    parser.add_argument("files", nargs="*", default=list(FILES), metavar="FILE")
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--samples", type=int, default=1024)
    options = parser.parse_args()
    require_blender()
    require_mitsuba()
    rows: dict[tuple[str, str], list[str]] = {}
    seconds = []
    for line in compared(options.files, options.size, options.samples):
        if isinstance(line, Line):
            cell = f"{line.measured:.1f} ({line.expected:.1f}) {100 * line.bias:+.2f} %"
            rows.setdefault((line.file, line.light), []).append(cell)
        else:
            seconds.append(line)
    head = ["file", "light", *COMPARED]
    for cells in (head, ["---"] * len(head), *([*names, *values] for names, values in rows.items())):
        sys.stdout.write(f"| {' | '.join(cells)} |\n")
    sys.stdout.write("\n" + "\n".join(seconds) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(run())
