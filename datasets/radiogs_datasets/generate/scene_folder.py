"""Writing a generated scene as a folder in the TensoIR layout (see ``tensoir``)."""

import hashlib
import json
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from radiogs.colour import srgb_encode

from ..image_files import read_hdr, write_exr, write_hdr, write_png
from ..tensoir import TRAINING_LIGHT
from .catalogue import Recipe, Rig, recipe
from .environments import environment
from .probe import require_mitsuba

SIZE = 64
TRAIN_VIEWS, TEST_VIEWS = 32, 8
TRAIN_SAMPLES, TEST_SAMPLES = 1024, 4096
PLASTIC_RATIO = 1.3247179572447460


def generate_scene(
    name: str, folder: Path, seed: int = 0, progress: Callable[[str, int, int], None] | None = None
) -> None:
    """Render the scene ``name`` into ``folder``: images, ground truth, lights, metadata.json.

    ``progress(what, done, total)`` is called after each view. Deterministic for a seed on one machine. Raises
    UsageError for an unknown name, or where Mitsuba cannot run.
    """
    made = recipe(name)
    require_mitsuba()
    from . import render

    render.start()
    (folder / "envmaps").mkdir(parents=True, exist_ok=True)
    lights = {}
    for role, light in ((TRAINING_LIGHT, made.training_light), *((light, light) for light in made.relight)):
        path = folder / "envmaps" / f"{role}.hdr"
        write_hdr(path, environment(light))
        # What is rendered is what is stored: RGBE keeps eight bits.
        lights[role] = render.build(made, read_hdr(path))
    total = TRAIN_VIEWS + TEST_VIEWS
    energy = np.zeros(2)
    for split, first, count in (("train", 0, TRAIN_VIEWS), ("test", TRAIN_VIEWS, TEST_VIEWS)):
        frames = []
        for place in range(count):
            camera = camera_matrix(made.rig, first + place)
            view = folder / f"{split}_{place:03}"
            view.mkdir(exist_ok=True)
            energy += _write_view(made, lights, camera, view, split == "test", seed + first + place)
            frames.append({"file_path": f"./{view.name}/rgba", "transform_matrix": camera.tolist()})
            if progress is not None:
                progress(view.name, first + place + 1, total)
        table = {"camera_angle_x": float(np.radians(made.rig.field_of_view)), "frames": frames}
        (folder / f"transforms_{split}.json").write_text(json.dumps(table, indent=1) + "\n")
    _write_metadata(made, lights[TRAINING_LIGHT], folder, seed, energy)


def camera_matrix(rig: Rig, place: int) -> NDArray[np.float64]:
    """Camera-to-world in OpenGL axes; the places form an R2 low-discrepancy sequence over the rig's patch."""
    along, across = (0.5 + (place + 1) * np.array([PLASTIC_RATIO**-1, PLASTIC_RATIO**-2])) % 1
    azimuth = np.radians(rig.azimuth[0] + along * (rig.azimuth[1] - rig.azimuth[0]))
    low, high = np.sin(np.radians(rig.elevation))
    height = low + across * (high - low)
    flat = np.sqrt(1 - height**2)
    backward = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), height])
    right = np.cross([0.0, 0.0, 1.0], backward)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([right, np.cross(backward, right), backward], -1)
    matrix[:3, 3] = np.array(rig.target) + rig.radius * backward
    return matrix


def _write_view(
    made: Recipe, lights: dict[str, object], camera: NDArray[np.float64], folder: Path, complete: bool, seed: int
) -> NDArray[np.float64]:
    """Write one view; returns the sums of its indirect and total radiance."""
    from . import render

    angle, samples = made.rig.field_of_view, TEST_SAMPLES if complete else TRAIN_SAMPLES

    def shot(light: str, depth: int) -> NDArray[np.float32]:
        return render.radiance(lights[light], camera, angle, SIZE, samples, depth, seed)

    full, direct = shot(TRAINING_LIGHT, render.GLOBAL_DEPTH), shot(TRAINING_LIGHT, render.DIRECT_DEPTH)
    seen = render.surface(lights[TRAINING_LIGHT], made, camera, angle, SIZE)
    # One alpha for every map of the view.
    alpha = np.where(seen.coverage > 0, full[..., 3:], 0)
    _write_image(folder / "rgba.png", full, alpha)
    indirect = np.where(alpha > 0, full[..., :3] - direct[..., :3], 0)
    if complete:
        write_png(folder / "albedo.png", np.concatenate([seen.albedo, alpha], -1))
        write_png(folder / "normal.png", np.concatenate([seen.normal * 0.5 + 0.5, alpha], -1))
        write_png(folder / "roughness.png", seen.roughness)
        write_exr(folder / "depth.exr", seen.depth)
        write_exr(folder / "direct.exr", np.where(alpha > 0, direct[..., :3], 0))
        write_exr(folder / "indirect.exr", indirect)
        for light in made.relight:
            relit = shot(light, render.GLOBAL_DEPTH)
            _write_image(folder / f"rgba_{light}.png", relit, alpha)
            bounced = relit[..., :3] - shot(light, render.DIRECT_DEPTH)[..., :3]
            write_exr(folder / f"indirect_{light}.exr", np.where(alpha > 0, bounced, 0))
    return np.array([indirect.sum(), full[..., :3].sum()], dtype=np.float64)


def _write_image(path: Path, image: NDArray[np.float32], alpha: NDArray[np.float32]) -> None:
    straight = image[..., :3] / np.where(image[..., 3:] > 0, image[..., 3:], 1)
    display = srgb_encode(torch.from_numpy(np.where(alpha > 0, straight, 0).astype(np.float32))).numpy()
    write_png(path, np.concatenate([display, alpha], -1))


def _write_metadata(made: Recipe, scene: object, folder: Path, seed: int, energy: NDArray[np.float64]) -> None:
    from . import render

    camera = camera_matrix(made.rig, TRAIN_VIEWS)
    twice = [
        render.radiance(scene, camera, made.rig.field_of_view, SIZE, TEST_SAMPLES, render.GLOBAL_DEPTH, 1_000_000 + place)
        for place in (seed, seed + 1)
    ]
    first, second = (srgb_encode(torch.from_numpy(image[..., :3])).clamp(0, 1) for image in twice)
    error = float((first - second).double().square().mean())
    metadata = {
        "scene": made.name,
        "purpose": made.purpose,
        "seed": seed,
        "samples": {"train": TRAIN_SAMPLES, "test": TEST_SAMPLES},
        "sampler": "multijitter",
        "depth": render.GLOBAL_DEPTH,
        "noise_floor_db": round(-10 * float(np.log10(error)), 2) if error > 0 else None,
        "indirect_share": round(float(energy[0] / energy[1]), 4),
        "lights": {
            path.stem: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted((folder / "envmaps").glob("*"))
        },
        "versions": {package: version(package) for package in ("mitsuba", "drjit", "numpy")},
    }
    (folder / "metadata.json").write_text(json.dumps(metadata, indent=1) + "\n")
