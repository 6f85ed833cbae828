"""Blender Cycles against Mitsuba: the project's own .blend files rendered by both, pass by pass.

    python -m radiogs_datasets.blend.agreement [--size N] [--samples N] [FILE ...]

Prints a Markdown table: for each pass PSNR between the renderers in dB, in brackets the PSNR that two renderers without
a difference would have at the noise of both (two seeds of each tell it), and the relative difference of sums.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..generate.cameras import Pinhole
from ..generate.environments import LIGHTS
from ..generate.probe import require_mitsuba
from ..image_files import read_hdr, write_exr, write_hdr
from . import own_files
from .cameras import shots
from .light_maps import refined
from .passes import Maps
from .process import Blender, require_blender
from .request import Request
from .studio import Studio

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
    from ..generate import render

    render.start()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        for name in names:
            for light, values in {"sky": LIGHTS["sky"].radiance(), "texel": texel()}.items():
                lights = folder / f"{name}-{light}"
                lights.mkdir()
                write_hdr(lights / "training.hdr", values)
                with Blender(folder / "blender.log") as blender:
                    file = own_files.write(name, folder, blender)
                    request = Request(file, lights, size=size, samples=samples, bounces=BOUNCES)
                    cycles, camera, seconds = _cycles(blender, request, view)
                scene = render.build(own_files.as_recipe(name), read_hdr(lights / "training.hdr"))
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
    from ..generate import render

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


def run() -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m radiogs_datasets.blend.agreement")
    parser.add_argument("files", nargs="*", default=list(own_files.FILES), metavar="FILE")
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
