"""Writing scenes: a new folder and its cameras for all writers, and a scene in another layout.

Cameras are ``transforms_*.json``: OpenGL camera-to-world and one field of view, as NeRF-synthetic has them. Cameras
that one angle cannot describe have a lens in pixels for each frame, as instant-ngp and nerfstudio read them. A layout's
writer takes maps as ``radiogs_core.scene.scene.MapName`` defines them.
"""

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

from radiogs_core.errors import DataError, UsageError, unknown
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.colour import srgb_decode, srgb_encode
from radiogs_core.scene.scene import Scene, View

from .image_files import write_exr, write_hdr, write_png


@contextmanager
def made_beside(folder: Path) -> Iterator[Path]:
    """A new folder beside ``folder`` to make a scene in; it takes the name at the end, and is removed after an error.

    A killed process leaves ``.unfinished-*``. Raises UsageError for a ``folder`` that holds something or cannot be
    written.
    """
    require_new(folder)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix=".unfinished-", dir=folder.parent) as room:
            made = Path(room) / folder.name
            made.mkdir()
            yield made
            made.replace(folder)
    except OSError as error:
        raise UsageError(
            f"cannot write {folder}", f"The system says: {error.strerror}.", "Choose another folder."
        ) from error


def require_new(folder: Path) -> None:
    """Raise UsageError unless a folder is absent or empty."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(
            f"{folder} exists already", "A scene is not written over files.", "Remove it, or choose another folder."
        )


PIXEL_TOLERANCE = 1e-3
"""Largest distance, in pixels, of a principal point from the middle, and difference of focal lengths, for one angle."""


def write_transforms(path: Path, views: Sequence[View], names: Sequence[str], lenses: bool = False) -> None:
    """Write the file; with ``lenses`` each frame has a lens in pixels if one angle cannot describe all cameras.

    Raises DataError for such cameras without ``lenses``.
    """
    table: dict[str, Any] = {}
    frames: list[dict[str, Any]] = [
        {"file_path": name, "transform_matrix": opengl(view.camera)} for view, name in zip(views, names, strict=True)
    ]
    try:
        table["camera_angle_x"] = _field_of_view(views)
    except DataError:
        if not lenses:
            raise
        for frame, view in zip(frames, views, strict=True):
            camera = view.camera
            frame |= {"fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy}
            frame |= {"w": camera.width, "h": camera.height}
    path.write_text(json.dumps({**table, "frames": frames}, indent=1) + "\n", encoding="utf-8")


def opengl(camera: Camera) -> list[list[float]]:
    """Camera-to-world rows in OpenGL axes: x right, y up, looking along -z."""
    matrix = camera.camera_to_world.double().clone()
    matrix[:3, 1:3] *= -1
    return matrix.tolist()


def _field_of_view(views: Sequence[View]) -> float:
    first = views[0].camera
    for view in views:
        camera = view.camera
        sizes = torch.tensor([camera.fx - first.fx, camera.fy - first.fx])
        middle = torch.tensor([camera.cx - camera.width / 2, camera.cy - camera.height / 2])
        if float(torch.cat([sizes, middle]).abs().max()) > PIXEL_TOLERANCE or camera.width != first.width:
            raise DataError(
                f"the camera of view '{view.name}' has no place in this layout",
                "It knows square pixels, a principal point in the middle and one field of view for a split; here "
                f"f = ({camera.fx:.2f}, {camera.fy:.2f}), c = ({camera.cx:.2f}, {camera.cy:.2f}) at "
                f"{camera.width} x {camera.height} pixels.",
                "Use the scene in the layout that it has.",
            )
    return 2 * math.atan(first.width / (2 * first.fx))


def write_display(
    path: Path, radiance: NDArray[np.float32], coverage: NDArray[np.float32], alpha: NDArray[np.float32]
) -> None:
    """PNG of straight sRGB and ``alpha``, from linear RGB that is multiplied by the picture's own ``coverage``."""
    straight = radiance[..., :3] / np.where(coverage > 0, coverage, 1)
    display = srgb_encode(torch.from_numpy(np.where(alpha > 0, straight, 0).astype(np.float32))).numpy()
    write_png(path, np.concatenate([display, alpha], -1))


def psnr(first: NDArray, second: NDArray) -> float | None:
    """PSNR in dB between two maps, two digits; None for equal maps."""
    error = float(np.square((first - second).astype(np.float64)).mean())
    return round(-10 * math.log10(error), 2) if error else None


Advance = Callable[[int, int], None]


def convert(scene: Scene, folder: Path, layout: str, advance: Advance = lambda done, total: None) -> tuple[str, ...]:
    """Write the scene below ``folder``; returns a sentence for each thing that the layout cannot store.

    Colours become 8-bit PNG, radiance half-float EXR, as the layout has them. ``advance`` receives (done, total) views.
    The folder is made beside its place and renamed at the end: an interrupted conversion leaves no half scene. Raises
    UsageError for an unknown layout, a folder that holds something or a scene with pixels that are left out, DataError
    for a damaged scene or for cameras that the layout cannot describe.
    """
    if layout not in WRITERS:
        raise unknown("layout to write", layout, WRITERS)
    if any(view.has("valid") for view in (*scene.train, *scene.test)):
        raise UsageError(
            f"pixels of scene '{scene.name}' are left out (--masks ignore), which no layout can carry",
            "They would be written as black.",
            "Convert the scene without its masks, and copy the masks beside it.",
        )
    with made_beside(folder) as made:
        return _write(scene, made, layout, advance)


def _write(scene: Scene, folder: Path, layout: str, advance: Advance) -> tuple[str, ...]:
    writer = WRITERS[layout]
    lost: list[str] = []
    done, total = 0, len(scene.train) + len(scene.test)
    for split, views in (("train", scene.train), ("test", scene.test)):
        names = [writer.frame(split, number) for number in range(len(views))]
        write_transforms(folder / f"transforms_{split}.json", views, names, writer.lenses)
        left: dict[str, int] = {}
        for number, view in enumerate(views):
            written = writer.view(folder, view, split, number)
            for name in sorted(view.sources.keys() - {"image", "alpha", *written}):
                left[name] = left.get(name, 0) + 1
            done += 1
            advance(done, total)
        lost += [f"{name} of {count} {split} views has no place in layout '{layout}'" for name, count in left.items()]
    lights = dict(scene.lights)
    if scene.training_light is not None:
        lights[writer.training_light or "training"] = scene.training_light
    for name, light in lights.items():
        if writer.light is None:
            lost.append(f"light '{name}' has no place in layout '{layout}'")
            continue
        _store(folder / writer.light.format(name), light.radiance)
    return tuple(lost)


Image = Float[Tensor, "height width channels"]
Mask = Float[Tensor, "height width 1"]
WriteView = Callable[[Path, View, str, int], list[str]]


@dataclass(frozen=True)
class Layout:
    """How a layout is written.

    ``frame``: a view's name in the transforms file from its split and number. ``view``: writes its image, coverage and
    other maps, and returns the other maps' names. ``light``: path of a light's map, Z up, with its name left open; None
    for a layout without lights. ``training_light``: name of the training light. ``lenses``: whether a frame may have a
    lens of its own.
    """

    frame: Callable[[str, int], str]
    view: WriteView
    light: str | None
    training_light: str | None
    lenses: bool = False


KINDS = {".png": write_png, ".exr": write_exr, ".hdr": write_hdr}


def _store(path: Path, image: Image, alpha: Mask | None = None) -> None:
    """Write an image, with alpha if given, in the format of its name's ending; makes the folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    KINDS[path.suffix](path, (image if alpha is None else torch.cat([image, alpha], -1)).numpy())


def _alpha(view: View) -> Mask:
    return view.read("alpha") if view.has("alpha") else torch.ones(view.camera.height, view.camera.width, 1)


def write_tensoir_view(folder: Path, view: View, split: str, number: int) -> list[str]:
    """Write one folder per view: everything that a scene can hold has a file."""
    place, alpha = folder / f"{split}_{number:03}", _alpha(view)
    _store(place / "rgba.png", view.read("image"), alpha)
    written = []
    for name in view.sources:
        if name in ("albedo", "normal", "roughness"):
            values = view.read(name) / 2 + 0.5 if name == "normal" else view.read(name)
            _store(place / f"{name}.png", values, None if name == "roughness" else alpha)
        elif name in ("depth", "direct", "indirect"):
            _store(place / f"{name}.exr", view.read(name))
        elif name.startswith("relit/") and name.endswith("/indirect"):
            _store(place / f"indirect_{name.split('/')[1]}.exr", view.read(name))
        elif name.startswith("relit/"):
            _store(place / f"rgba_{name.split('/')[1]}.png", view.read(name), alpha)
        else:
            continue
        written.append(name)
    return written


def write_synthetic4relight_view(folder: Path, view: View, split: str, number: int) -> list[str]:
    """Write training views as linear EXR on black with a mask, test views as PNG with albedo in sRGB."""
    alpha, stem = _alpha(view), f"{number:03}"
    if split == "train":
        _store(folder / f"train/{stem}_rgb.exr", srgb_decode(view.read("image")) * alpha)
        _store(folder / f"train/{stem}_mask.png", alpha)
        return []
    _store(folder / f"test/{stem}_rgba.png", view.read("image"), alpha)
    written = []
    if view.has("albedo"):
        _store(folder / f"test/{stem}_albedo.png", srgb_encode(view.read("albedo")), alpha)
        written.append("albedo")
    if view.has("roughness"):
        _store(folder / f"test/{stem}_rough.png", view.read("roughness").expand(-1, -1, 3), alpha)
        written.append("roughness")
    for name in view.sources:
        if name.startswith("relit/") and not name.endswith("/indirect"):
            _store(folder / f"test_rli/{name.split('/')[1]}_{stem}.png", view.read(name), alpha)
            written.append(name)
    return written


def write_blender_view(folder: Path, view: View, split: str, number: int) -> list[str]:
    """Write the image and its coverage, nothing else."""
    _store(folder / f"{split}/r_{number}.png", view.read("image"), _alpha(view))
    return []


WRITERS: Mapping[str, Layout] = {
    "tensoir": Layout(
        lambda split, number: f"./{split}_{number:03}/rgba", write_tensoir_view, "envmaps/{}.hdr", "training"
    ),
    "synthetic4relight": Layout(
        lambda split, number: f"{split}/{number:03}", write_synthetic4relight_view, "{}.exr", "envmap3"
    ),
    "blender": Layout(lambda split, number: f"./{split}/r_{number}", write_blender_view, None, None, lenses=True),
}

LAYOUTS = tuple(WRITERS)
