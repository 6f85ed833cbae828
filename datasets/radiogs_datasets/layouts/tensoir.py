"""The TensoIR-Synthetic layout, with the ground truth that this project's generator adds.

    <scene>/transforms_train.json  transforms_test.json
    <scene>/<view>/rgba.png  albedo.png  normal.png  roughness.png  depth.exr  direct.exr  indirect.exr
    <scene>/<view>/rgba_<light>.png  indirect_<light>.exr
    <scene>/envmaps/<light>.hdr, or <scene>/lights.json and lights/<map>.hdr beside the scenes

Images are display sRGB with straight alpha; albedo is linear; normals are world-space, n / 2 + 1 / 2; cameras are
camera-to-world in OpenGL axes. TensoIR_Ind has ``indirect.png``: straight sRGB, taken here for outgoing radiance, which
nothing public confirms; an ``indirect.exr`` takes precedence. ``training.hdr`` is the training light, if known.
TensoIR's archive has a folder ``Environment_Maps`` beside the scenes or one level up; ground truth was rendered under
its 2k maps, TensoIR's training images under ``sunset``, TensoIR_Ind's under an unknown light, unless ``envmap`` in a
view's ``metadata.json`` states it. Scenes that share maps name them in ``lights.json``, each with the columns by which
it is turned to the right: ``{"training": {"map": "sunset", "turned": 37}, ...}``.
"""

import re
from collections.abc import Callable, Mapping, Set
from functools import partial
from operator import index
from pathlib import Path

import torch
from torch import Tensor

from radiogs_core.errors import DataError
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene, View

from ..bounded_reading import read_json
from ..cameras.transforms import Transforms, read_splits, said_of_files
from ..image_files import read_hdr
from ..image_structure import Header
from ..lights import latitude_longitude
from ..view_maps import read_alpha, read_colour, read_depth, read_displayed, read_normal, read_photo, read_value
from .inspection import decode_if_small, inside, inspect, require_distinct, require_files, require_same_size

MASKED_MAPS: Mapping[str, tuple[str, Callable[[Path, Path], Tensor]]] = {
    "normal.png": ("normal", read_normal),
    "depth.exr": ("depth", read_depth),
    "indirect.png": ("indirect", read_displayed),
}
"""Map and reader by file name, for maps that need the alpha of the view's image."""

MAPS: Mapping[str, tuple[str, Callable[[Path], Tensor]]] = {
    "albedo.png": ("albedo", read_colour),
    "roughness.png": ("roughness", read_value),
    "direct.exr": ("direct", read_colour),
    "indirect.exr": ("indirect", read_colour),
}

TRAINING_LIGHT = "training"
UNSTATED = ("under which map its training images were taken is not stated: recovered light is not scored",)
SHARED_LIGHTS = "lights.json"
ARCHIVE_TRAINING_LIGHT = "sunset"
ARCHIVE_FOLDERS = ("Environment_Maps/high_res_envmaps_2k", "Environment_Maps/high_res_envmaps_1k")

RELIT_IMAGE = re.compile(r"rgba_(.+)\.png")
RELIT_INDIRECT = re.compile(r"indirect_(.+)\.exr")


def looks_like(folder: Path) -> bool:
    """Whether a view's folder holds an ``rgba.png``."""
    return next(folder.glob("*/rgba.png"), None) is not None


def load_tensoir(folder: Path) -> Scene:
    """Read a scene; its maps are read when asked for.

    The header, size and layout of every file are checked here, and in a small scene all pixels too. Raises DataError
    that names the file, or all files that are missing.
    """
    files = read_splits(folder)
    images = {table: [_image(folder, table, frame.file_path) for frame in each.frames] for table, each in files.items()}
    require_distinct(folder, [image.parent for paths in images.values() for image in paths])
    maps = {table: _common_maps(folder, paths) for table, paths in images.items()}
    _, maps_of_test = maps.values()
    found = find_lights(folder, {relit[1] for name in maps_of_test if (relit := RELIT_IMAGE.fullmatch(name))})
    every = [image.parent / name for table in files for image in images[table] for name in (image.name, *maps[table])]
    named = {path.relative_to(folder).as_posix(): path for path in (*files, *every)}
    named |= {f"envmaps/{light}.hdr": path for light, (path, _) in found.items()}
    headers, checksum = inspect(named, [path for path in [folder / SHARED_LIGHTS] if path.is_file()])
    lights = {
        light: EnvironmentMap(read_light(path).radiance.roll(columns, 1)) for light, (path, columns) in found.items()
    }
    training_light = lights.pop(TRAINING_LIGHT, None)
    train, test = (_views(folder, each, images[table], maps[table], headers) for table, each in files.items())
    unstated = UNSTATED if lights and training_light is None else ()
    repairs = (*said_of_files(files), *decode_if_small([*train, *test], headers), *unstated)
    return Scene(folder.name, "tensoir", train, test, lights, training_light, checksum, repairs)


def _image(folder: Path, table: Path, file_path: str) -> Path:
    """The image of a frame. Links are followed, but a written path may not leave the scene's folder."""
    image = inside(folder, table, file_path if file_path.endswith(".png") else f"{file_path}.png")
    if image.parent == folder:
        raise DataError(
            f"{table} points to '{file_path}'",
            "Each view has a folder of its own inside the scene's folder; nothing outside that is read.",
            "Correct the file.",
        )
    return image


def _common_maps(folder: Path, images: list[Path]) -> list[str]:
    """File names of the maps beside the images of a split: what one view has, all must have."""
    beside = {path.name for image in images if image.parent.is_dir() for path in image.parent.iterdir()}
    relit = {name for name in beside if RELIT_IMAGE.fullmatch(name) or RELIT_INDIRECT.fullmatch(name)}
    names = sorted(beside & (MAPS.keys() | MASKED_MAPS.keys()) | relit)
    require_files(folder, [image.parent / name for image in images for name in (image.name, *names)])
    return names


def _views(
    folder: Path, transforms: Transforms, images: list[Path], maps: list[str], headers: Mapping[Path, Header]
) -> tuple[View, ...]:
    views = []
    for frame, image in zip(transforms.frames, images, strict=True):
        for path in (image.parent / name for name in maps):
            require_same_size(path, headers[path].size, headers[image].size)
        camera = transforms.camera(frame, *headers[image].size)
        views.append(View(image.parent.relative_to(folder).as_posix(), camera, _sources(image, maps)))
    return tuple(views)


def _sources(image: Path, maps: list[str]) -> dict[str, Callable[[], Tensor]]:
    """How to read each map, by the name that ``radiogs_core.scene.scene.MapName`` gives it."""
    sources: dict[str, Callable[[], Tensor]] = {
        "image": partial(read_photo, image),
        "alpha": partial(read_alpha, image),
    }
    for file, (name, read_masked) in MASKED_MAPS.items():
        if file in maps:
            sources[name] = partial(read_masked, image.parent / file, image)
    for file, (name, read) in MAPS.items():
        if file in maps:
            sources[name] = partial(read, image.parent / file)
    for file in maps:
        if relit := RELIT_IMAGE.fullmatch(file):
            sources[f"relit/{relit[1]}"] = partial(read_photo, image.parent / file)
        elif relit := RELIT_INDIRECT.fullmatch(file):
            sources[f"relit/{relit[1]}/indirect"] = partial(read_colour, image.parent / file)
    return sources


def find_lights(folder: Path, relit: Set[str]) -> dict[str, tuple[Path, int]]:
    """Map and columns of turning of each light of a scene whose test views have images under the lights ``relit``.

    The training light is called TRAINING_LIGHT. Raises DataError if the scene has or names maps, but not for each of
    these lights. With no map anywhere the scene is still good for everything but relighting.
    """
    shared = _shared_lights(folder / SHARED_LIGHTS)
    own = {path.stem: (path, 0) for path in sorted((folder / "envmaps").glob("*.hdr"))} or shared
    if not own:  # TensoIR's archive has the finer maps first; its rotated lights (sunset_120) have images but no map
        for archive in (parent / name for parent in (folder.parent, folder.parent.parent) for name in ARCHIVE_FOLDERS):
            found = {path.stem: (path, 0) for path in sorted(archive.glob("*.hdr"))}
            if found:
                training = found.get(_stated_light(folder))
                wanted = {light: each for light, each in found.items() if light in relit}
                return wanted | ({TRAINING_LIGHT: training} if training else {})
        return {}
    if relit - own.keys():
        raise DataError(
            f"scene '{folder.name}' has no environment map for: {', '.join(sorted(relit - own.keys()))}",
            "Its test views have images under these lights; without the maps they cannot be relit.",
            f"Add {folder / 'envmaps'}/<light>.hdr, or remove the images rgba_<light>.png.",
        )
    require_files(folder.parent, [path for path, _ in own.values()])
    return own


def _stated_light(folder: Path) -> str:
    """The archive's light of the training images, by a view's ``metadata.json``, else TensoIR's.

    Empty if it is not stated and ``indirect.png`` exists: the light of TensoIR_Ind was not published.
    """
    about = next(iter(sorted(folder.glob("train_*/metadata.json"))), None)
    stated = {} if about is None else read_json(about)
    named = stated.get("envmap") if isinstance(stated, dict) else None
    if isinstance(named, str) and named:
        return Path(named).stem
    return "" if next(folder.glob("*/indirect.png"), None) else ARCHIVE_TRAINING_LIGHT


def _shared_lights(table: Path) -> dict[str, tuple[Path, int]]:
    """Maps of the set, and columns by which they are turned, by light; empty without the file.

    Raises DataError for an entry that is not as the head of this module shows it.
    """
    entries, maps = read_json(table) if table.is_file() else {}, table.parent.parent / "lights"
    try:
        named = {light: (f"{each['map']}.hdr", index(each["turned"])) for light, each in entries.items()}
    except (AttributeError, KeyError, TypeError) as error:
        raise DataError(
            f"{table} names no map and columns of turning for each light",
            "A map's name is the name of a .hdr file in the folder 'lights' beside the scene.",
            'Write, for example, {"training": {"map": "sunset", "turned": 37}}.',
        ) from error
    return {light: (inside(maps, table, name), columns) for light, (name, columns) in named.items()}


def read_light(path: Path) -> EnvironmentMap:
    """The stored map, taken as Z up. Raises DataError if it is damaged, or no latitude-longitude map."""
    return EnvironmentMap(latitude_longitude(path, torch.from_numpy(read_hdr(path)))[0])
