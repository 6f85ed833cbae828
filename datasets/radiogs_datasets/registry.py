"""Scenes by name: scenes of the package, or a folder on disk in any known layout."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from radiogs_core.errors import DataError, UsageError, did_you_mean, unknown
from radiogs_core.scene.scene import Scene

from .bounded_reading import printable
from .data_root import OTHERS, TINY, below, below_root, data_root, in_data_sets, scene_names
from .furnace import ALBEDOS, furnace
from .generate.surfaces import metadata_of, surfaces_of_scene
from .hard_scenes import BASE, CONDITIONS, HARD_CASES, hard_cases, hard_scene
from .layouts import blender, colmap, llff, stanford_orb, synthetic4relight, tensoir
from .layouts.inspection import shown
from .options import AS_STORED, SceneOptions
from .reduction import resized
from .same_bytes import SameBytes
from .soundness import few_views_or_pixels, require_names, require_placed, require_shaped, shared_images
from .unused import unused_files

FORWARD = Path(__file__).parent / "forward"
"""A few larger views of some miniatures: for comparing images, too few to learn from."""


@dataclass(frozen=True)
class Layout:
    """A layout: the marks of its folders, in words and as a test, and its loader.

    ``load`` takes an absolute path without "..". ``of_photos``: whether views can be held out and masks given, as for
    captures; its ``load`` takes SceneOptions.
    """

    marks: str
    looks_like: Callable[[Path], bool]
    load: Callable[..., Scene]
    of_photos: bool = False


LAYOUTS: Mapping[str, Layout] = {
    "tensoir": Layout("a folder a view with rgba.png", tensoir.looks_like, tensoir.load_tensoir),
    "synthetic4relight": Layout(
        "train/<id>_rgb.exr", synthetic4relight.looks_like, synthetic4relight.load_synthetic4relight
    ),
    "stanford-orb": Layout("test_mask/", stanford_orb.looks_like, stanford_orb.load_stanford_orb),
    "colmap": Layout("sparse/0/cameras.bin or sparse/cameras.bin", colmap.looks_like, colmap.load_colmap, True),
    "blender": Layout("transforms_train.json or transforms.json", blender.looks_like, blender.load_blender, True),
    "llff": Layout("poses_bounds.npy", llff.looks_like, llff.load_llff, True),
}
"""Layouts in the order in which they are tried: more specific marks first."""


def forward_names() -> tuple[str, ...]:
    """Names of the scenes that light transport is compared on: larger views of miniatures, and furnaces."""
    return (*sorted(path.name for path in FORWARD.iterdir() if (path / "transforms_test.json").is_file()), *ALBEDOS)


def known_names() -> tuple[str, ...]:
    """Names of all scenes that come with the package."""
    return (*scene_names(), *forward_names(), HARD_CASES, *CONDITIONS)


def comes_with_package(folder: Path) -> bool:
    """Whether a scene's folder is committed with the package."""
    return folder.parent in (TINY, OTHERS, FORWARD)


def scene_kind(name_or_path: str) -> str | None:
    """The kind that a scene's metadata state, over which tables take means; None without one, or without a scene."""
    return scene_facts(name_or_path).get("kind")


def scene_choices(name_or_path: str) -> str | None:
    """Whether settings may be chosen by a scene's results: "tuned on" or "reported only"; None if not stated."""
    return scene_facts(name_or_path).get("choices")


def scene_facts(name_or_path: str) -> dict[str, str]:
    """The texts of a scene's ``metadata.json`` by their names, such as kind, choices and maker; empty for no scene."""
    try:
        about = metadata_of(scene_folder(name_or_path))
    except (DataError, OSError):
        return {}
    return {name: text for name, text in about.items() if isinstance(text, str) and text.isprintable()}


def scene_folder(name_or_path: str) -> Path:
    """The folder of a scene. Raises DataError for a name that is neither a miniature nor a folder."""
    for room in (TINY, OTHERS, FORWARD):
        if name_or_path in (*scene_names(), *forward_names()) and (room / name_or_path).is_dir():
            return room / name_or_path
    folder = located(name_or_path)
    if folder is None:
        known = known_names()
        raise DataError(
            f"there is no scene '{printable(name_or_path)}'",
            f"It is neither a folder{below_root()} nor one of the scenes that come with the package"
            f" ({', '.join(known)}).",
            did_you_mean(name_or_path, known) or "Give a scene's name, or the path of its folder.",
        )
    return folder


def located(name_or_path: str) -> Path | None:
    """The folder of that path; else the one below the root of data (``data_root``); None if neither exists.

    A scene's name alone is looked for in each data set, ``<data set>/<scene>`` also in folders between, such as
    ``stanford-orb/blender_LDR/<scene>``. Raises DataError if several match.
    """
    folder, root = Path(name_or_path), data_root()
    if folder.is_dir() or root is None:
        return folder if folder.is_dir() else None
    if (root / folder).is_dir() and _is_scene(root / folder):
        return root / folder
    sought = below(root, folder) if len(folder.parts) > 1 else in_data_sets(root, folder.name)
    found = [each for each in sought if _is_scene(each)]
    if len(found) > 1:
        raise DataError(
            f"there are {len(found)} scenes '{name_or_path}' in {root}",
            f"They are {', '.join(str(each.relative_to(root)) for each in found)}.",
            "Name one of them.",
        )
    if found:
        return found[0]
    return root / folder if (root / folder).is_dir() else None


def _is_scene(folder: Path) -> bool:
    return any(layout.looks_like(folder) for layout in LAYOUTS.values())


def load_scene(name_or_path: str, layout: str | None = None, options: SceneOptions = AS_STORED) -> Scene:
    """A miniature by its name, or the scene in a folder; for a folder that bears such a name write ``./name``.

    The layout is recognised from the folder's files unless ``layout`` or the options name it. A generated scene knows
    its surfaces. Raises UsageError for an unknown layout and for options that the layout does not take, DataError for a
    folder without a scene, and for an incomplete or damaged one.
    """
    try:
        scene = resized(_as_stored(name_or_path, layout or options.layout, options), options)
    except (OSError, UnicodeEncodeError) as error:
        # Asking whether a file is there fails where its name is too long, or its folder may not be read.
        raise DataError(
            f"the files of '{printable(name_or_path)}' cannot be looked up",
            f"The system says: {getattr(error, 'strerror', None) or 'the name cannot be encoded'}.",
            "Shorten or correct the name where it is written, or make the folder readable.",
        ) from error
    return replace(scene, options=options.plain(), repairs=(*scene.repairs, *few_views_or_pixels(scene)))


def _as_stored(name_or_path: str, layout: str | None, options: SceneOptions) -> Scene:
    if name_or_path in ALBEDOS or name_or_path == HARD_CASES:
        _require_none(options, name_or_path)
        made, by = (hard_cases(), hard_cases) if name_or_path == HARD_CASES else (furnace(name_or_path), furnace)
        return replace(made, loaders=(by.__module__,))
    if name_or_path in CONDITIONS:
        return hard_scene(name_or_path, _as_stored(BASE, None, options))
    folder = scene_folder(name_or_path)
    chosen = _recognised(folder) if layout is None else layout
    if chosen not in LAYOUTS:
        raise unknown("layout", chosen, LAYOUTS)
    load = LAYOUTS[chosen].load
    place, files = Path(os.path.normpath(folder.absolute())), SameBytes(folder.name)
    if LAYOUTS[chosen].of_photos:
        scene = files.read(lambda: load(place, options))
        held = "" if options.hold_out is None else f"/hold-out{options.hold_out}"
        left_out = "/masks-ignore" if options.masks == "ignore" else ""
        straight = "/undistorted" if options.undistorted else ""
        scene = replace(scene, checksum=f"{scene.checksum}{held}{left_out}{straight}")
    else:
        _require_none(options, name_or_path)
        scene = files.read(lambda: load(place))
    said = (*unused_files(folder, files.digests), *shared_images(scene, files.digests | files.pixels))
    scene = files.held(replace(scene, repairs=(*scene.repairs, *said)))
    require_names(scene)
    require_shaped(scene)
    require_placed(scene)
    surfaces = surfaces_of_scene(folder, scene)
    known_by = () if surfaces is None else (surfaces_of_scene.__module__,)
    return replace(scene, folder=folder, loaders=(load.__module__,), surfaces=surfaces, surfaces_by=known_by)


def _require_none(options: SceneOptions, scene: str) -> None:
    if any(each is not None for each in (options.hold_out, options.mask_folder, options.masks, options.undistorted)):
        raise UsageError(
            f"scene '{scene}' has test views and masks of its own, and pinhole images",
            "Views are held out, masks are read and lenses are told of photos alone: layouts colmap, blender and llff.",
            "Leave --hold-out, --mask-folder, --masks and --undistorted out.",
        )


def _recognised(folder: Path) -> str:
    for name, layout in LAYOUTS.items():
        if layout.looks_like(folder):
            return name
    below = sorted({*folder.glob("*/"), *folder.glob("*/*/")})
    inner = [str(place) for place in below if place.is_dir() and place.name[0] != "." and _is_scene(place)]
    raise DataError(
        f"{folder} is no scene in a known layout",
        "Looked for: " + "; ".join(f"{layout.marks} ({name})" for name, layout in LAYOUTS.items()) + ".",
        f"Give the folder of one scene{f' ({shown(inner)})' if inner else ''}, or name its layout with --layout.",
    )
