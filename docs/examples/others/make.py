"""The set ``others``: ten scenes that this project's generator did not think of, rendered by Blender Cycles.

    pip install "radiogs-bench[blend]"
    python docs/examples/others/make.py MESHES LIGHTS OUT [SCENE ...] [--size N] [--workers N]

MESHES: a folder of odedstein/meshes (commit 8352132). LIGHTS: city.hdr, studio.hdr, sunset.hdr and forest.hdr of
pmndrs/assets (commit d8709a9), which are from Poly Haven. OUT gets a folder a scene and ``lights``, whose maps all
scenes share: a scene's ``lights.json`` tells which map it has under which name, and by how many columns it is turned.

A map has 256 rows, and is scaled so that the brightest white diffuse surface has radiance 1.05. The sun of maps
``*_sun`` was hidden: a disc was added, with the diameter, direction, colour and share of the light that SUNS gives.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import texel_directions
from radiogs_core.scene.scene import View
from radiogs_datasets.blend.process import blender_python
from radiogs_datasets.blend.request import Request
from radiogs_datasets.blend.scene_folder import write_scene
from radiogs_datasets.generate.recipe import Rig, pinhole
from radiogs_datasets.image_files import read_exr, read_hdr, write_exr, write_hdr
from radiogs_datasets.writing import write_transforms

ROWS = 256
BRIGHTEST = 1.05
"""Radiance of the white diffuse surface that a map lights most."""

POLY_HAVEN = "Poly Haven, by way of pmndrs/assets (commit d8709a9)"
MESHES = "odedstein/meshes (commit 8352132)"


@dataclass(frozen=True)
class Sun:
    """A disc that is added to a map: degrees across, where it is (degrees), its colour, and its share of all light."""

    map: str
    across: float
    elevation: float
    azimuth: float
    colour: tuple[float, float, float]
    share: float


SUNS: Mapping[str, Sun] = {
    "city_sun": Sun("city", 0.7, 38.0, 60.0, (1.0, 0.93, 0.82), 0.6),
    "forest_sun": Sun("forest", 2.0, 40.0, 41.0, (1.0, 0.9, 0.74), 0.55),
    "sunset_sun": Sun("sunset", 5.0, 14.0, 36.0, (1.0, 0.62, 0.33), 0.5),
}


@dataclass(frozen=True)
class Plan:
    """How a scene is seen and lit, and what is told of it.

    lights: maps and columns of turning, the training light's first. samples: a pixel, of training and of test views.
    azimuth, elevation: where cameras stand, degrees.
    """

    purpose: str
    kind: str
    choices: str
    lights: Mapping[str, int]
    meshes: tuple[str, ...]
    samples: tuple[int, int]
    azimuth: tuple[float, float] = (0.0, 360.0)
    elevation: tuple[float, float] = (8.0, 70.0)
    not_represented: str = ""


TUNED, REPORTED = "tuned on", "reported only"
FRONT, LOW = (-40.0, 40.0), (2.0, 38.0)
SUNNY, SOFT, BEFORE_WALLS = "scans under a sun", "scans under soft light", "scans before walls, from the front"

PLANS: Mapping[str, Plan] = {
    "spot": Plan(
        "a model of a cow with blotches and mud on a meadow, under a sun of two degrees", SUNNY, TUNED,
        {"forest_sun": 40, "city": 100, "sunset": 300}, ("spot",), (192, 384),
    ),
    "workbench": Plan(
        "a scanned boot and hammer on a table before a wall, by studio lamps, from the front", BEFORE_WALLS, TUNED,
        {"studio": 174, "city_sun": 28, "sunset": 461}, ("boot", "hammer"), (192, 320), FRONT, LOW,
    ),
    "shoal": Plan(
        "three glazed fish that shade one another, under a sun of 0.7 degrees", SUNNY, TUNED,
        {"city_sun": 200, "forest": 70, "studio": 10}, ("fish",), (160, 416),
    ),
    "boot": Plan(
        "a scanned boot whose leather has a clear coat, at sunset", SOFT, TUNED,
        {"sunset": 120, "studio": 400, "city": 330}, ("boot",), (96, 192), not_represented="a clear coat",
    ),
    "nefertiti": Plan(
        "a scanned bust with worn paint, under a cloudy sky", SOFT, REPORTED,
        {"city": 0, "sunset_sun": 210, "studio": 120}, ("nefertiti",), (96, 192),
    ),
    "orators": Plan(
        "two scanned busts that shade one another, before a sun of five degrees in haze", SUNNY, REPORTED,
        {"sunset_sun": 130, "city": 400, "forest": 250}, ("demosthenes", "nefertiti"), (128, 256),
    ),
    "trophy": Plan(
        "a goat's head on an off-white wall, under a sun of two degrees, from the front", BEFORE_WALLS, REPORTED,
        {"forest_sun": 101, "studio": 82, "sunset": 446}, ("goathead",), (128, 256), FRONT, LOW,
    ),
    "still_life": Plan(
        "three objects on a table with a wall, by studio lamps, from one side", "still life with a wall", REPORTED,
        {"studio": 96, "forest_sun": 115, "sunset": 432}, ("boot", "fish", "spot"), (256, 512),
        (-75.0, 75.0), (5.0, 60.0),
    ),
    "grotto": Plan(
        "a fish in a deep basin of veined marble, under a sun of 0.7 degrees", "hollow of stone", REPORTED,
        {"city_sun": 20, "sunset": 350, "forest": 130}, ("fish",), (128, 640), elevation=(30.0, 78.0),
    ),
    "hammer": Plan(
        "a scanned hammer with a head of steel, at sunset", "scan with metal", REPORTED,
        {"sunset": 400, "forest_sun": 60, "city": 200}, ("hammer",), (96, 192), not_represented="a metallic part",
    ),
}  # fmt: skip

TITLES: Mapping[str, tuple[str, str, str]] = {
    "nefertiti": ("Nefertiti", "Nora Al-Badri and Jan Nikolai Nelles", "public domain"),
    "fish": ("Fish (Blub)", "Keenan Crane", "public domain"),
    "spot": ("Spot", "Keenan Crane", "public domain"),
    "demosthenes": ("Louvre: Demosthenes (photoscan)", "ryanfb", "CC BY 4.0"),
    "boot": ("Harrison work boot", "inciprocal", "CC BY 4.0"),
    "hammer": ("Hammer (raw scan)", "Andrea Spognetta (Spogna)", "CC BY 4.0"),
    "goathead": ("Goat head", "hugoelec", "CC BY 3.0"),
}
"""Title, author and licence of each mesh. They were scaled, turned, and given other materials."""

RADIUS, FIELD_OF_VIEW = 4.0311289, 39.6
TRAINING_VIEWS, TEST_VIEWS = 40, 6
BITS, SMALLEST = 7, 2.0**-12
"""Precision of stored radiance: significant bits, and the step below which there is none. Its error lies 20 dB and more
below the noise, and files are two fifths smaller."""


def main() -> None:
    """Make the scenes that are named, or all of them."""
    parser = argparse.ArgumentParser(description="Render the set of scenes by other hands.")
    parser.add_argument("meshes", type=Path)
    parser.add_argument("lights", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("scenes", nargs="*", help=", ".join(PLANS))
    parser.add_argument("--size", type=int, default=96)
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    write_maps(given.lights, given.out / "lights")
    for name in given.scenes or PLANS:
        if not (given.out / name).is_dir():
            make(name, given)


def write_maps(source: Path, folder: Path) -> None:
    """The maps of the set, in the size and scale that they are stored in."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("city", "studio", "sunset", "forest", *SUNS):
        stored = folder / f"{name}.hdr"
        if not stored.is_file():
            sun = SUNS.get(name)
            full = read_hdr(source / f"{sun.map if sun else name}.hdr")
            light = np.asarray(cv2.resize(full, (2 * ROWS, ROWS), interpolation=cv2.INTER_AREA), np.float32)
            light = with_sun(light, sun) if sun else light
            write_hdr(stored, light * (BRIGHTEST / brightest(light)))


def with_sun(light: NDArray[np.float32], sun: Sun) -> NDArray[np.float32]:
    """The map with a disc whose edge is as sharp as texels allow; a texel holds its share of the disc."""
    fine = 8
    elevation, azimuth = np.radians(sun.elevation), np.radians(sun.azimuth)
    towards = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    inside = texel_directions(fine * ROWS, 2 * fine * ROWS).numpy() @ towards > np.cos(np.radians(sun.across / 2))
    disc = inside.reshape(ROWS, fine, 2 * ROWS, fine).mean((1, 3))[..., None] * np.array(sun.colour)
    energy = (solid_angles()[..., None] * light).sum() * sun.share / (1 - sun.share)
    return (light + disc * (energy / (solid_angles()[..., None] * disc).sum())).astype(np.float32)


def solid_angles() -> NDArray[np.float64]:
    """Steradians of each texel, up to a constant factor."""
    height = np.sin((np.arange(ROWS) + 0.5) / ROWS * np.pi)
    return np.repeat(height[:, None], 2 * ROWS, 1) * (np.pi / ROWS) ** 2


def brightest(light: NDArray[np.float32]) -> float:
    """Mean over channels of irradiance / pi on the surface that a map lights most, of directions 5 degrees apart."""
    directions = texel_directions(ROWS, 2 * ROWS).numpy().reshape(-1, 3)
    faced = texel_directions(36, 72).numpy().reshape(-1, 3)
    energy = (light.mean(-1) * solid_angles()).reshape(-1)
    return float(max(np.clip(directions @ normal, 0, None) @ energy for normal in faced) / np.pi)


def make(name: str, given: argparse.Namespace) -> None:
    """Render one scene, put its shared maps into ``lights.json``, and complete its metadata."""
    plan, folder = PLANS[name], given.out / name

    def progress(done: int, total: int) -> None:
        sys.stderr.write(f"{name}: {done} of {total} views\n")

    with tempfile.TemporaryDirectory() as made:
        files = Path(made)
        script = Path(__file__).with_name("blend_files.py")
        subprocess.run([blender_python(), script, given.meshes, files, name], check=True, stdout=subprocess.DEVNULL)
        (files / "lights").mkdir()
        for place, (light, turned) in enumerate(plan.lights.items()):
            role = light if place else "training"
            write_hdr(
                files / "lights" / f"{role}.hdr", np.roll(read_hdr(given.out / "lights" / f"{light}.hdr"), turned, 1)
            )
        write_cameras(plan, given.size, files)
        request = Request(file=files / f"{name}.blend", lights=files / "lights", cameras=str(files), size=given.size,
                          samples=plan.samples[0], test_samples=plan.samples[1], bounces=32)  # fmt: skip
        write_scene(request, folder, given.workers, 1, progress)
    finish(folder, plan)


def write_cameras(plan: Plan, size: int, folder: Path) -> None:
    """Transforms files of the scene's cameras, which look at the origin."""
    rig = Rig((0.0, 0.0, 0.0), RADIUS, plan.azimuth, plan.elevation, FIELD_OF_VIEW)
    focal = size / (2 * np.tan(np.radians(FIELD_OF_VIEW) / 2))
    views = []
    for number in range(TRAINING_VIEWS + TEST_VIEWS):
        pose = torch.from_numpy(pinhole(rig, number, size).to_world.copy())
        pose[:3, 1:3] *= -1
        views.append(View(str(number), Camera(pose.float(), focal, focal, size / 2, size / 2, size, size), {}))
    for split, part in (("train", views[:TRAINING_VIEWS]), ("test", views[TRAINING_VIEWS:])):
        write_transforms(folder / f"transforms_{split}.json", part, [f"./{view.name}" for view in part])


def finish(folder: Path, plan: Plan) -> None:
    """Refer to the set's maps instead of copies, round radiance, and tell kind, makers and licences."""
    shutil.rmtree(folder / "envmaps")
    for unused in folder.glob("*/incident_indirect.exr"):
        unused.unlink()
    for radiance in (path for name in ("direct", "indirect") for path in folder.glob(f"*/{name}*.exr")):
        write_exr(radiance, rounded(read_exr(radiance)))
    lights = {light if place else "training": {"map": light, "turned": turned}
              for place, (light, turned) in enumerate(plan.lights.items())}  # fmt: skip
    (folder / "lights.json").write_text(json.dumps(lights, indent=1) + "\n", encoding="utf-8")
    path = folder / "metadata.json"
    told = json.loads(path.read_text(encoding="utf-8"))
    suns = {light: f"a disc of {sun.across} degrees added to {sun.map}, {sun.share:.0%} of all light"
            for light, sun in SUNS.items() if light in plan.lights}  # fmt: skip
    meshes = [TITLES[name] for name in plan.meshes]
    credits = [
        {"title": title, "author": author, "licence": licence, "source": MESHES} for title, author, licence in meshes
    ]
    maps = sorted({SUNS[light].map if light in SUNS else light for light in plan.lights})
    credits += [{"title": f"{light} (environment map)", "author": "Poly Haven", "licence": "CC0", "source": POLY_HAVEN}
                for light in maps]  # fmt: skip
    path.write_text(json.dumps({
        **told, "scene": folder.name, "purpose": plan.purpose, "kind": plan.kind, "choices": plan.choices,
        "maker": "other hands", "licence": ", ".join(sorted({licence for _, _, licence in meshes})), "credits": credits,
        **({"not_represented": plan.not_represented} if plan.not_represented else {}),
        "training_light": next(iter(plan.lights)), "suns": suns,
    }, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")  # fmt: skip


def rounded(radiance: NDArray[np.float32]) -> NDArray[np.float32]:
    """Radiance as precisely as it is stored."""
    mantissa, exponent = np.frexp(np.round(radiance.astype(np.float64) / SMALLEST) * SMALLEST)
    return np.ldexp(np.round(mantissa * 2**BITS) / 2**BITS, exponent).astype(np.float32)


if __name__ == "__main__":
    main()
