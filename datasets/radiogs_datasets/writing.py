"""Writing a scene in another layout, and saying what that layout cannot carry.

A layout's writer takes maps as ``radiogs_core.scene.scene.MapName`` defines them, and returns the names of those that
it wrote.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.errors import UsageError, unknown
from radiogs_core.scene.colour import srgb_decode, srgb_encode
from radiogs_core.scene.scene import Scene, View

from .image_files import write_exr, write_hdr, write_png
from .new_scene import made_beside, write_transforms

Advance = Callable[[int, int], None]


def convert(scene: Scene, folder: Path, layout: str, advance: Advance = lambda done, total: None) -> tuple[str, ...]:
    """Write the scene below ``folder``; returns a sentence for each thing that the layout cannot carry.

    Colours become 8-bit PNG, radiance half-float EXR, as the layout has them. ``advance`` is told (done, total) views.
    The folder is made beside its place and renamed at the end: an interrupted conversion leaves no half scene. Raises
    UsageError for an unknown layout, a folder that holds something or a scene with pixels that are left out, DataError
    for a damaged scene or for cameras that the layout cannot say.
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
            for name in sorted(view.sources.keys() - set(written)):
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
        path = folder / writer.light.format(name)
        path.parent.mkdir(exist_ok=True)
        (write_hdr if path.suffix == ".hdr" else write_exr)(path, light.radiance.numpy())
    return tuple(lost)


Image = Float[Tensor, "height width channels"]
Mask = Float[Tensor, "height width 1"]
WriteView = Callable[[Path, View, str, int], list[str]]


@dataclass(frozen=True)
class Layout:
    """How a layout is written.

    ``frame`` names a view's entry in the transforms file from its split and number; ``view`` writes its maps;
    ``light`` is the path of a light's map, Z up, with its name left open, or None where the layout has no lights;
    ``training_light`` the name of the training light. ``lenses``: whether a
    frame may have a lens of its own.
    """

    frame: Callable[[str, int], str]
    view: WriteView
    light: str | None
    training_light: str | None
    lenses: bool = False


def _png(path: Path, image: Image, alpha: Mask | None = None) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_png(path, (image if alpha is None else torch.cat([image, alpha], -1)).numpy())


def _exr(path: Path, image: Image) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_exr(path, image.numpy())


def _alpha(view: View) -> Mask:
    return view.read("alpha") if view.has("alpha") else torch.ones(view.camera.height, view.camera.width, 1)


def write_tensoir_view(folder: Path, view: View, split: str, number: int) -> list[str]:
    """One folder a view: everything that a scene can hold has a file."""
    place, alpha = folder / f"{split}_{number:03}", _alpha(view)
    _png(place / "rgba.png", view.read("image"), alpha)
    written = ["image", "alpha"]
    for name in view.sources:
        if name == "albedo":
            _png(place / "albedo.png", view.read(name), alpha)
        elif name == "normal":
            _png(place / "normal.png", view.read(name) / 2 + 0.5, alpha)
        elif name == "roughness":
            _png(place / "roughness.png", view.read(name))
        elif name in ("depth", "direct", "indirect"):
            _exr(place / f"{name}.exr", view.read(name))
        elif name.startswith("relit/") and name.endswith("/indirect"):
            _exr(place / f"indirect_{name.split('/')[1]}.exr", view.read(name))
        elif name.startswith("relit/"):
            _png(place / f"rgba_{name.split('/')[1]}.png", view.read(name), alpha)
        else:
            continue
        written.append(name)
    return written


def write_synthetic4relight_view(folder: Path, view: View, split: str, number: int) -> list[str]:
    """Training views as linear EXR on black with a mask, test views as PNG with albedo in sRGB."""
    alpha, stem = _alpha(view), f"{number:03}"
    if split == "train":
        _exr(folder / f"train/{stem}_rgb.exr", srgb_decode(view.read("image")) * alpha)
        _png(folder / f"train/{stem}_mask.png", alpha)
        return ["image", "alpha"]
    _png(folder / f"test/{stem}_rgba.png", view.read("image"), alpha)
    written = ["image", "alpha"]
    if view.has("albedo"):
        _png(folder / f"test/{stem}_albedo.png", srgb_encode(view.read("albedo")), alpha)
        written.append("albedo")
    if view.has("roughness"):
        _png(folder / f"test/{stem}_rough.png", view.read("roughness").expand(-1, -1, 3), alpha)
        written.append("roughness")
    for name in view.sources:
        if name.startswith("relit/") and not name.endswith("/indirect"):
            _png(folder / f"test_rli/{name.split('/')[1]}_{stem}.png", view.read(name), alpha)
            written.append(name)
    return written


def write_blender_view(folder: Path, view: View, split: str, number: int) -> list[str]:
    """The image and its coverage, nothing else."""
    _png(folder / f"{split}/r_{number}.png", view.read("image"), _alpha(view))
    return ["image", "alpha"]


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
