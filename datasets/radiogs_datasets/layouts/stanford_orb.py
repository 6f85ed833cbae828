"""The layout of Stanford-ORB's captures for Blender-style readers.

    blender_LDR|blender_HDR/<capture>/transforms_{train,test,novel}.json
                                      {train,test}/<k>.png|exr  {train,test}_mask/<k>.png
    ground_truth/<capture>/env_map/<k>.exr  surface_normal/<k>.npy  z_depth/<k>.npy  pseudo_gt_albedo/<k>.png

``ground_truth`` lies beside ``blender_LDR``, or beside the capture. Maps of 2048 pixels become 512 by area means, as in
the benchmark's evaluator. PNG and albedo are sRGB (albedo becomes linear), EXR is linear and shown as display sRGB,
clipped. Normals and environment maps are stored in each view's camera, and are turned into the world. A view of
``transforms_novel.json`` shows the object in another capture, under a light of its own: ``Scene.relight``.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.errors import DataError
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.colour import srgb_decode
from radiogs_core.scene.light import EnvironmentMap, texel_directions
from radiogs_core.scene.scene import Scene, View

from ..bounded_reading import as_float32, read_json, read_numpy
from ..cameras.transforms import Transforms, read_splits, read_transforms, said_of_files
from ..image_files import in_unit_range, read_stored
from ..lights import read_light
from ..view_maps import displayed_light, read_colour
from .inspection import decode_if_small, inside, inspect, require_distinct, require_files, require_same_size
from .masks import read_mask

SIDE = 512
"""Pixels a side to which larger maps are reduced if their side is a multiple of it."""

TRUE_MAPS = {"albedo": ("pseudo_gt_albedo", ".png"), "normal": ("surface_normal", ".npy"), "depth": ("z_depth", ".npy")}
"""Folder and ending of the ground truth by map."""


def looks_like(folder: Path) -> bool:
    """Whether images lie beside masks in folders of their own."""
    return (folder / "test_mask").is_dir() and (folder / "transforms_train.json").is_file()


def load_stanford_orb(folder: Path) -> Scene:
    """Read a capture; its maps are read when asked for. Raises DataError that names what is wrong."""
    truth = ground_truth_folder(folder)
    tables = read_splits(folder)
    images = {
        table: [_image(folder, table, frame.file_path) for frame in each.frames] for table, each in tables.items()
    }
    train_images, test_images = images.values()
    every = [*train_images, *test_images]
    require_distinct(folder, every)
    masks = [_mask(path) for path in every]
    require_files(folder, [*every, *masks])
    relight, lights, novel_files = _novel(folder)
    files = {path.relative_to(folder).as_posix(): path for path in (*tables, *every, *masks)}
    true_files = [path for image in test_images for path in _truth_of(truth, image).values()]
    files |= {f"ground_truth/{path.parent.name}/{path.name}": path for path in true_files}
    headers, checksum = inspect(files | novel_files, numbers=masks)
    train, test = (
        tuple(
            _view(folder, transforms, place, path, truth if paths is test_images else None, headers[path].size)
            for place, path in enumerate(paths)
        )
        for transforms, paths in zip(tables.values(), images.values(), strict=True)
    )
    repairs = (*said_of_files(tables), *decode_if_small([*train, *test, *relight], headers))
    return Scene(folder.name, "stanford-orb", train, test, lights, None, checksum, repairs, relight)


def light_in_the_world(stored: EnvironmentMap, camera_to_world: Float[Tensor, "4 4"]) -> EnvironmentMap:
    """A map stored in a view's camera axes, as Z-up map of the world.

    Stored: OpenGL axes of the camera (x right, y up, z towards the viewer), v = acos(y) / pi, u = 1/2 + atan2(x, -z) /
    2 pi. ``camera_to_world`` has OpenCV axes.
    """
    height, width = stored.radiance.shape[:2]
    world = texel_directions(height, width)
    right, down, forward = (world @ camera_to_world[:3, :3].double()).unbind(-1)
    # With (x', y', z') = (-z, -x, y) of the OpenGL axes the Z-up lookup is the stored one.
    return EnvironmentMap(stored.lookup(torch.stack([forward, -right, -down], -1).float()))


def reduced(image: Float[Tensor, "height width channels"]) -> Float[Tensor, "rows columns channels"]:
    """Area means with SIDE pixels a side, for images whose side is a multiple of it."""
    factor = image.shape[0] // SIDE
    if factor < 2 or image.shape[0] % SIDE or image.shape[1] % factor:
        return image
    return image.unflatten(0, (-1, factor)).unflatten(2, (-1, factor)).mean((1, 3))


def ground_truth_folder(folder: Path) -> Path | None:
    """The folder of a capture's ground truth; None if it was not downloaded."""
    places = (folder.parent.parent / "ground_truth" / folder.name, folder.parent / "ground_truth" / folder.name)
    return next((place for place in places if place.is_dir()), None)


def true_mesh_file(folder: Path) -> Path | None:
    """The scanned mesh of a capture, in the frame of its cameras; None if it is missing."""
    truth = ground_truth_folder(folder)
    path = None if truth is None else truth / "mesh_blender" / "mesh.obj"
    return path if path is not None and path.is_file() else None


def _truth_of(truth: Path | None, image: Path) -> dict[str, Path]:
    """The existing files of a test image's ground truth, by map."""
    if truth is None:
        return {}
    files = {name: truth / place / f"{image.stem}{end}" for name, (place, end) in TRUE_MAPS.items()}
    return {name: path for name, path in files.items() if path.is_file()}


def _image(folder: Path, table: Path, file_path: str) -> Path:
    stem = inside(folder, table, file_path)
    linear, display = (stem.with_name(stem.name + end) for end in (".exr", ".png"))
    return linear if linear.is_file() else display


def _mask(image: Path) -> Path:
    return image.parent.with_name(f"{image.parent.name}_mask") / f"{image.stem}.png"


def _view(
    folder: Path, transforms: Transforms, place: int, image: Path, truth: Path | None, size: tuple[int, int]
) -> View:
    height, width = reduced(torch.empty(*size, 1)).shape[:2]
    camera = transforms.camera(transforms.frames[place], height, width)
    readers: dict[str, Callable[[Path], Tensor]] = {
        "image": _shown,
        "alpha": _coverage,
        "albedo": lambda path: srgb_decode(reduced(read_colour(path))),
        "normal": partial(_normal, camera, _mask(image)),
        "depth": partial(_depth, _mask(image)),
    }
    files = {"image": image, "alpha": _mask(image), **_truth_of(truth, image)}
    sized = {
        name: partial(_of_size, partial(readers[name], path), path, (height, width)) for name, path in files.items()
    }
    return View(image.relative_to(folder).with_suffix("").as_posix(), camera, sized)


def _of_size(
    read: Callable[[], Float[Tensor, "height width channels"]], path: Path, wanted: tuple[int, int]
) -> Float[Tensor, "height width channels"]:
    """A map of a view, which must have the view's size: a map of one pixel would be spread over all."""
    values = read()
    require_same_size(path, (values.shape[0], values.shape[1]), wanted)
    return values


def _novel(folder: Path) -> tuple[tuple[View, ...], dict[str, EnvironmentMap], dict[str, Path]]:
    """The object in other captures: views in this capture's frame, a light for each, and the files they come from."""
    table = folder / "transforms_novel.json"
    if not table.is_file():
        return (), {}, {}
    views, lights, files = [], {}, {"transforms_novel.json": table}
    content = read_json(table)
    frames = content.get("frames") if isinstance(content, dict) else None
    if not isinstance(frames, list) or not all(isinstance(frame, dict) for frame in frames):
        raise DataError(f"{table}: 'frames' must be a list of objects", "", "Correct the file, or remove it.")
    for place, frame in enumerate(frames):
        capture, angle = frame.get("scene_name"), frame.get("camera_angle_x")
        if not isinstance(capture, str) or "/" in capture or capture in ("", ".", ".."):
            raise DataError(f"{table}: frame {place} has no 'scene_name'", "It says which capture shows it.")
        single = read_transforms(table, {"camera_angle_x": angle, "frames": [frame]})
        other = folder.parent / capture
        image = _image(other, table, single.frames[0].file_path)
        truth = ground_truth_folder(other)
        light = None if truth is None else truth / "env_map" / f"{image.stem}.exr"
        mask = _mask(image)
        if light is None or not all(path.is_file() for path in (image, mask, light)):
            continue  # a capture that was not downloaded
        camera = single.camera(single.frames[0], *_shown(image).shape[:2])
        name = f"{capture}/{image.stem}"
        lights[name] = light_in_the_world(read_light(light)[0], camera.camera_to_world)
        alpha = partial(_of_size, partial(_coverage, mask), mask, (camera.height, camera.width))
        views.append(View(name, camera, {f"relit/{name}": partial(_shown, image), "alpha": alpha}))
        files |= {f"novel/{name}/image": image, f"novel/{name}/mask": mask, f"novel/{name}/light": light}
    return tuple(views), lights, files


def _shown(path: Path) -> Float[Tensor, "height width 3"]:
    stored = read_stored(path)
    image = reduced(torch.from_numpy(in_unit_range(stored)))[..., :3].expand(-1, -1, 3)
    return displayed_light(image, None) if stored.dtype == np.float32 else image


def _coverage(path: Path) -> Float[Tensor, "height width 1"]:
    return reduced(read_mask(path))


def _normal(camera: Camera, mask: Path, path: Path) -> Float[Tensor, "height width 3"]:
    right, up, back = _numbers(path, 3).unbind(-1)
    world = torch.stack([right, -up, -back], -1) @ camera.axes.T
    require_same_size(path, (world.shape[0], world.shape[1]), (camera.height, camera.width))
    return torch.where(_coverage(mask) > 0, torch.nn.functional.normalize(world, dim=-1), 0.0)


def _depth(mask: Path, path: Path) -> Float[Tensor, "height width 1"]:
    depth, coverage = _numbers(path, 1), _coverage(mask)
    require_same_size(path, (depth.shape[0], depth.shape[1]), (coverage.shape[0], coverage.shape[1]))
    return torch.where(coverage > 0, depth, 0.0)


def _numbers(path: Path, channels: int) -> Float[Tensor, "height width channels"]:
    values = np.atleast_3d(read_numpy(path))
    if values.ndim != 3 or values.shape[2] < channels or not values.size or values.dtype.kind != "f":
        raise DataError(f"{path} is no map of {channels} channels", f"It holds {values.dtype} of shape {values.shape}.")
    return reduced(torch.from_numpy(as_float32(path, values[..., :channels])))
