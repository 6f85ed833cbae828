"""The layout of Synthetic4Relight (InvRender).

    <scene>/transforms_train.json  transforms_test.json     file_path: train/<id>, test/<id>
    <scene>/train/<id>_rgb.exr  <id>_mask.png
    <scene>/test/<id>_rgba.png  <id>_albedo.png  <id>_rough.png
    <scene>/test_rli/<light>_<id>.png
    <light>.exr beside the scene, or in it; envmap3 is the training light

Training images are linear and on black (as Blender writes EXR; inferred): they are divided by their mask and shown as
display sRGB, clipped. Test images, relit images and albedo are sRGB with straight alpha; albedo becomes linear. Maps of
lights have Z up; negative radiance is set to zero, with a note.
"""

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.colour import srgb_decode
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene, View

from ..cameras.transforms import read_splits, said_of_files
from ..lights import read_light
from ..view_maps import displayed_light, read_alpha, read_colour, read_photo, read_value
from .inspection import decode_if_small, inside, inspect, require_distinct, require_files, require_same_size
from .masks import read_mask

TRAINING_LIGHT = "envmap3"

TEST_MAPS: dict[str, tuple[str, Callable[[Path], Tensor]]] = {
    "albedo": ("_albedo.png", lambda path: srgb_decode(read_colour(path))),
    "roughness": ("_rough.png", read_value),
}
"""Map: ending of its file, and how it is read."""


def looks_like(folder: Path) -> bool:
    """Whether there are linear training images."""
    return next(folder.glob("train/*_rgb.exr"), None) is not None


def load_synthetic4relight(folder: Path) -> Scene:
    """Read a scene; its maps are read when asked for. Raises DataError that names what is wrong."""
    files = read_splits(folder)
    stems = {table: [inside(folder, table, frame.file_path) for frame in each.frames] for table, each in files.items()}
    train_stems, test_stems = stems.values()
    train_split, test_split = files.values()
    require_distinct(folder, [*train_stems, *test_stems])
    lights, light_files = _lights(folder, test_stems)
    endings = [end for end, _ in TEST_MAPS.values() if any(_with(stem, end).is_file() for stem in test_stems)]
    train_files = [[_with(stem, "_rgb.exr"), _with(stem, "_mask.png")] for stem in train_stems]
    test_files = [
        [*(_with(stem, end) for end in ("_rgba.png", *endings)), *(_relit(folder, light, stem) for light in lights)]
        for stem in test_stems
    ]
    every = [path for paths in (*train_files, *test_files) for path in paths]
    require_files(folder, every)
    require_distinct(folder, [image for image, *_ in (*train_files, *test_files)])
    named = {path.relative_to(folder).as_posix(): path for path in (*files, *every)}
    named |= {f"{light}.exr": path for light, path in light_files.items()}
    headers, checksum = inspect(named, numbers=[mask for _, mask in train_files])
    for image, *maps in (*train_files, *test_files):
        for path in maps:
            require_same_size(path, headers[path].size, headers[image].size)
    train = tuple(
        View(
            frame.file_path.removeprefix("./"),
            train_split.camera(frame, *headers[image].size),
            {"image": partial(_display, image, mask), "alpha": partial(read_mask, mask)},
        )
        for frame, (image, mask) in zip(train_split.frames, train_files, strict=True)
    )
    test = tuple(
        View(
            frame.file_path.removeprefix("./"),
            test_split.camera(frame, *headers[image].size),
            _test_maps(folder, stem, lights),
        )
        for frame, stem, (image, *_) in zip(test_split.frames, test_stems, test_files, strict=True)
    )
    radiance: dict[str, EnvironmentMap] = {}
    repairs = [*said_of_files(files), *decode_if_small([*train, *test], headers)]
    for light, path in light_files.items():
        radiance[light], said = read_light(path)
        repairs += said
    relight = {light: radiance[light] for light in lights if light in radiance}
    training_light = radiance.get(TRAINING_LIGHT)
    return Scene(folder.name, "synthetic4relight", train, test, relight, training_light, checksum, tuple(repairs))


def _lights(folder: Path, stems: list[Path]) -> tuple[list[str], dict[str, Path]]:
    """Lights with relit images, and the files of these lights and of the training light."""
    names = [path.name for path in (folder / "test_rli").glob("*.png")]
    found = {
        match[1]
        for name in names
        for stem in stems
        if (match := re.fullmatch(rf"(.+)_{re.escape(stem.name)}\.png", name))
    }
    files = {}
    for light in sorted(found | {TRAINING_LIGHT}):
        place = next((place for place in (folder, folder.parent) if (place / f"{light}.exr").is_file()), None)
        if place is not None:
            files[light] = place / f"{light}.exr"
    return sorted(found), files


def _test_maps(folder: Path, stem: Path, lights: list[str]) -> dict[str, Callable[[], Tensor]]:
    image = _with(stem, "_rgba.png")
    sources: dict[str, Callable[[], Tensor]] = {
        "image": partial(read_photo, image),
        "alpha": partial(read_alpha, image),
    }
    for name, (ending, read) in TEST_MAPS.items():
        if _with(stem, ending).is_file():
            sources[name] = partial(read, _with(stem, ending))
    return sources | {f"relit/{light}": partial(read_photo, _relit(folder, light, stem)) for light in lights}


def _display(image: Path, mask: Path) -> Float[Tensor, "height width 3"]:
    return displayed_light(read_colour(image), read_mask(mask))


def _relit(folder: Path, light: str, stem: Path) -> Path:
    return folder / "test_rli" / f"{light}_{stem.name}.png"


def _with(stem: Path, ending: str) -> Path:
    return stem.with_name(stem.name + ending)
