"""Whether a scene is usable: its position and size, its names, and whether it shows enough.

Cameras and surfels are float32, so a scene far from the origin for its size has cameras on a coarse grid, and squares
of very small or large lengths lose digits. Both are refused here by name: otherwise they end in a worse image. Scenes
that show little get warnings, because metrics of such images mean little.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Scene, View

from .bounded_reading import require_storable
from .image_files import in_unit_range
from .layouts.inspection import shown

SMALLEST_EXTENT, LARGEST_EXTENT = 1e-4, 1e7
"""Bounds of ``Scene.extent``, in world units, between which results do not depend on the unit (docs/reliability.md:
measurements). From about 1e8 on gradients of positions, which shrink as lengths grow, come near Adam's epsilon."""

FARTHEST = 100.0
"""Largest distance of the scene's middle from the origin, in units of its extent. At 900, differences of neighbouring
points are too coarse to derive normals from depth; at 90 training losses are as for smaller shifts."""

OF_PHOTOS = ("colmap", "blender", "llff")
"""Layouts whose masks and alpha were drawn by people."""

OUTLIER, GAP, MOST_OUTLIERS = 8.0, 2.5, 0.2
"""A camera is damage at so many times the median distance from the cameras' middle, if that is also so many times the
next nearer camera's distance (unlike on any path), and if at most this share of cameras lies there."""

FLOAT32_STEP = 2.0**-23
PIXEL_SHARE = 0.25
"""Largest share of a pixel by which rounding a camera's position to float32 may move the point that it looks at."""

MOST_OBLONG = 16
"""Largest ratio of an image's longer to its shorter side."""


SHORTEST_LENS, LONGEST_LENS = 0.005, 5e3
"""Bounds of a focal length, in longer sides of its image: angles of view of 179 and of 0.01 degrees."""


def require_placed(scene: Scene) -> None:
    """Raise DataError for cameras out of all proportion, and for a scene too small, too large or too far away."""
    views = [*scene.train, *scene.test]
    if not scene.train:
        return
    origins = torch.stack([view.camera.centre for view in views]).double()
    away = (origins - origins.median(0).values).norm(dim=-1)
    middle, lost = float(away.median()), _outliers(away)
    if lost:
        named = ", ".join(f"{views[place].name} ({float(away[place]):.3g})" for place in lost[:3])
        raise DataError(
            f"{len(lost)} of {len(views)} cameras of scene '{scene.name}' are out of proportion: {named}",
            f"The others are about {middle:.3g} world units from their middle. Such a pose was not found, and would set"
            " the scene's unit of length.",
            "Correct their poses, or take these views out of the scene.",
        )
    extent = scene.extent
    if extent <= 0:
        return
    if not SMALLEST_EXTENT <= extent <= LARGEST_EXTENT:
        raise DataError(
            f"scene '{scene.name}' is {extent:.3g} world units large",
            f"Between {SMALLEST_EXTENT:g} and {LARGEST_EXTENT:g} results do not depend on the unit of length.",
            f"Divide the translations of all cameras (and points and depth) by {extent:.3g}.",
        )
    worst = max(views, key=lambda view: _rounding(view, scene.centre))
    share = _rounding(worst, scene.centre)
    if share > PIXEL_SHARE or float(scene.centre.norm()) > FARTHEST * extent:
        raise DataError(
            f"scene '{scene.name}' lies {float(worst.camera.centre.norm()):.3g} world units from the origin and is"
            f" {extent:.3g} large",
            f"In float32 its cameras stand on a grid that moves the image of {worst.name} by {share:.2g} pixels, and"
            f" its surfaces on one as coarse; up to {FARTHEST:g} times its size is accepted.",
            "Subtract the mean of the cameras' places from all of them (and from points).",
        )


def _outliers(away: torch.Tensor) -> list[int]:
    """The cameras beyond the first out-of-proportion gap of distances, farthest first."""
    order = away.argsort()
    near, far = away[order[:-1]], away[order[1:]]
    gaps = ((far > OUTLIER * away.median()) & (far > GAP * near) & (away.median() > 0)).nonzero()[:, 0]
    lost = [] if not len(gaps) else order[int(gaps[0]) + 1 :].flip(0).tolist()
    return lost if len(lost) <= max(1, MOST_OUTLIERS * len(away)) else []


def _rounding(view: View, centre: torch.Tensor) -> float:
    """Pixels by which half a float32 step of the camera's place moves what it looks at; 0 if that is itself."""
    camera = view.camera
    step = 0.5 * FLOAT32_STEP * float(camera.centre.abs().max())
    distance = float((camera.centre.double() - centre).norm())
    return max(camera.fx, camera.fy) * step / distance if distance > 0 and math.isfinite(distance) else 0.0


def require_shaped(scene: Scene) -> None:
    """Raise DataError for images too oblong to be matched at reduced size, and for lenses that see nearly half of all
    directions or next to none."""
    for view in (*scene.train, *scene.test):
        camera, said = view.camera, f"view '{view.name}' of scene '{scene.name}' has"
        size, focal = (camera.width, camera.height), (camera.fx, camera.fy)
        if max(size) > MOST_OBLONG * min(size):
            raise DataError(
                f"{said} {size[0]} x {size[1]} pixels",
                f"A side is up to {MOST_OBLONG} times as long as the other: views are matched at a reduced size.",
                "Cut the images, or take such views out of the scene.",
            )
        if not SHORTEST_LENS * max(size) <= min(focal) <= max(focal) <= LONGEST_LENS * max(size):
            raise DataError(
                f"{said} a focal length of {focal[0]:g} (x) and {focal[1]:g} (y) for {size[0]} x {size[1]} pixels",
                "No lens sees more than 179 degrees, or less than a hundredth of one, in straight lines.",
                "Correct the focal length; it is in pixels of the image, angles of view are in radians.",
            )


def require_names(scene: Scene) -> None:
    """Raise DataError for names of scene, views or lights that cannot name files, or would share one."""
    require_storable(scene.name, "the scene's folder")
    train, test = ([view.name for view in views] for views in (scene.train, scene.test))
    for names in (train, test, list(scene.lights), [name for name in test if name in {*train}] * 2):
        _require_apart(scene, names)
    for view in (*scene.train, *scene.test, *scene.relight):
        require_storable(view.name.replace("/", "_"), "a view")
    for light in scene.lights:
        require_storable(light.replace("/", "_"), "a light")


def _require_apart(scene: Scene, names: list[str]) -> None:
    stored: dict[str, str] = {}
    for name in names:
        place = name.replace("/", "_")
        if (other := stored.get(place)) is not None:
            both = f"two views called '{name}'" if other == name else f"views or lights '{other}' and '{name}'"
            raise DataError(
                f"scene '{scene.name}' has {both}",
                f"The renders of both would be stored as '{place}', one over the other.",
                "Rename the image of one of them; an ending (.png, .jpg) is no part of a view's name.",
            )
        stored[place] = name


SSIM_WINDOW = 11
"""Pixels of the window that SSIM compares: a smaller image has none."""

FEWEST_VIEWS = 3
"""Fewest training views for a point to be seen from two sides reliably."""

FEWEST_PIXELS = 64
"""Fewest covered pixels of a view for meaningful metrics."""

SAME_POSE = 0.01
"""Largest distance (in shares of the cameras' spacing) and largest angle (radians) between equal poses."""

NOT_NEW = "test views are not new"
"""Words by which sentences on test views that also are training views are recognised."""


def not_new_in(repairs: Sequence[str]) -> list[str]:
    """The sentences among a scene's repairs on test views that training has, too."""
    return [said for said in repairs if NOT_NEW in said]


def shared_poses(scene: Scene) -> tuple[str, ...]:
    """A sentence on test views with the pose of a training view; none for a computed scene, which has few poses."""
    if not scene.train or not scene.test or scene.folder is None:
        return ()
    splits = ([view.camera.camera_to_world for view in views] for views in (scene.train, scene.test))
    poses = (torch.stack(split).double() for split in splits)
    (train, axes), (test, turned_axes) = ((pose[:, :3, 3], pose[:, :3, :3].flatten(1)) for pose in poses)
    apart = torch.cdist(train, train)
    near = torch.where(apart > 1e-9 * apart.max(), apart, math.inf).min(-1).values
    spacing = float(known.median()) if len(known := near[near.isfinite()]) else 0.0  # all may be at one place
    turned = torch.cdist(turned_axes, axes) / 2**0.5  # radians, for small turns
    same = (torch.cdist(test, train) <= SAME_POSE * spacing) & (turned <= SAME_POSE)
    pairs = [
        f"{scene.test[place].name} ({scene.train[int(row.nonzero()[0])].name})"
        for place, row in enumerate(same)
        if bool(row.any())
    ]
    said = f"{len(pairs)} of {len(scene.test)} {NOT_NEW}: a training view has their pose: {shown(pairs)}"
    return (said,) if pairs else ()


def shared_images(scene: Scene, digests: Mapping[str, bytes]) -> tuple[str, ...]:
    """A sentence on test views with the image of a training view.

    ``digests``: of files or of their pixels, by absolute path; sources of the views are as a layout's loader made them.
    """
    train = {digest: view.name for view in scene.train if (digest := _digest(view, digests)) is not None}
    pairs = [f"{view.name} ({train[digest]})" for view in scene.test if (digest := _digest(view, digests)) in train]
    said = f"{len(pairs)} of {len(scene.test)} {NOT_NEW}: a training view has their image: {shown(pairs)}"
    return (said,) if pairs else ()


def _digest(view: View, digests: Mapping[str, bytes]) -> bytes | None:
    """The digest of the file of a view's image: of the path, or of the photo's path, that its source was given."""
    given = (getattr(each, "image", each) for each in getattr(view.sources.get("image"), "args", ()))
    return next((digests.get(str(path)) for path in given if isinstance(path, Path)), None)


def few_views_or_pixels(scene: Scene) -> tuple[str, ...]:
    """Findings: few or no new views, all cameras at one position, or images smaller than SSIM's window."""
    said = []
    if 0 < (views := len(scene.train)) < FEWEST_VIEWS:
        said.append(f"{views} view{'s' * (views > 1)} to learn from: shape, light and materials are not determined")
    elif scene.train and scene.extent == 0:
        said.append("all training cameras stand in one place: depth is not determined")
    if len(scene.test) == 1:
        said.append("1 view to score: its metrics are of that view alone")
    small = [view for view in scene.test if min(view.camera.height, view.camera.width) < SSIM_WINDOW]
    if small:
        few = f"{len(small)} view{'s' * (len(small) > 1)}"
        said.append(f"{few} to score with less than {SSIM_WINDOW} pixels a side: SSIM has no value there")
    lights = {**scene.lights, "of training": scene.training_light}
    dark = [name for name, light in lights.items() if light is not None and not light.radiance.any()]
    said += [f"light {name} is black throughout: what it lights is black" for name in dark]
    return (*said, *shared_poses(scene))


def require_trainable(scene: Scene) -> None:
    """Raise DataError for training views that cannot determine a shape: a single one, or all from one place."""
    views = len(scene.train)
    if views == 1 or (views > 1 and scene.extent == 0):
        raise DataError(
            f"scene '{scene.name}' has one view to learn from"
            if views == 1
            else f"the cameras of all {views} training views of scene '{scene.name}' stand in one place",
            "Depth is told by how points move between views from several places; without it every shape fits.",
            "Add views from other places"
            + ("; or, if views are there, hold fewer out:  --hold-out 8" if views == 1 else ", or correct the poses."),
        )


def little_evidence(image: torch.Tensor, alpha: torch.Tensor | None) -> Iterator[str]:
    """Sentences on an image [height, width, 3], values or levels of 8 bits, of one colour or with hardly any cover."""
    for step in (SPARSE, 1):  # few pixels show that an image has two levels
        seen = image[::step, ::step] if alpha is None else image[::step, ::step][alpha[::step, ::step, 0] > 0]
        if several := seen.numel() > 0 and bool(seen.max() > seen.min()):
            break
    if seen.numel() and not several:
        most = 255.0 if image.dtype == torch.uint8 else 1.0
        level = {0.0: "black", most: "white"}.get(float(seen.max()), "one colour")
        yield f"its image is {level} throughout: nothing can be learnt or scored from it"
    half = 127 if alpha is not None and alpha.dtype == torch.uint8 else 0.5
    covered = FEWEST_PIXELS if alpha is None else np.count_nonzero(alpha.numpy() > half)  # torch's sum copies to int64
    if covered < FEWEST_PIXELS:
        yield f"{covered} of its pixels show the object: its metrics are those of a few pixels"


SPARSE = 16
"""Step of the rows and columns that are checked first."""

RING = 2
"""Pixels at the border of an image that are looked at."""

MOST_VIEWS, MOST_PIXELS = 0.8, 0.8
"""Shares of the views, and of the ring's pixels in a view, from which a property counts for all: some objects touch the
border."""

ONE_COLOUR = 6 / 255
"""Largest difference of display sRGB within one colour: JPEG artefacts reach it."""

FEWEST_HOLES = 0.002
"""Share of uncovered pixels below which masks have no holes."""


class Frame(NamedTuple):
    """An image's border and middle: coverage of both and of the whole, the border's median colour, and the share of its
    pixels that have it."""

    border: float
    middle: float
    whole: float
    colour: torch.Tensor
    flat: float

    @staticmethod
    def of(image: torch.Tensor, alpha: torch.Tensor | None, valid: torch.Tensor | None = None) -> "Frame":
        """The frame of an image [height, width, 3] with its coverage, 1 without one, and the pixels that count.

        Image and coverage are values in [0, 1] or levels of 8 bits.
        """
        height, width = image.shape[:2]
        middle = whole = 1.0
        if alpha is not None:
            third = alpha[height // 3 : -(height // 3) or None, width // 3 : -(width // 3) or None]
            most = 255 if alpha.dtype == torch.uint8 else 1
            middle, whole = (float(each.numpy().mean(dtype=np.float64)) / most for each in (third, alpha))
        ring = _ring(image)
        cover = torch.ones(len(ring)) if alpha is None else _ring(alpha)[:, 0]
        if valid is not None:
            ring, cover = (each[_ring(valid)[:, 0] > 0] for each in (ring, cover))
        if not len(ring):
            return Frame(0.0, middle, whole, torch.zeros(3), 0.0)
        colour = ring.median(0).values
        flat = ((ring - colour).abs().amax(-1) <= ONE_COLOUR).float().mean()
        return Frame(float(cover.mean()), middle, whole, colour, float(flat))


def _ring(image: torch.Tensor) -> torch.Tensor:
    """The pixels [count, channels] at the border of an image, as values in [0, 1]."""
    rows, columns = (torch.arange(side) for side in image.shape[:2])
    edge, side = ((each < RING) | (each >= len(each) - RING) for each in (rows, columns))
    pixels = torch.cat([image[edge].flatten(0, 1), image[:, side][~edge].flatten(0, 1)])
    return torch.from_numpy(in_unit_range(pixels.numpy()))


def doubtful_coverage(scene: Scene, frames: Sequence[Frame]) -> Iterator[str]:
    """Sentences on masks that may be inverted or mark pixels to ignore, and on a uniform ground without masks."""
    if len(frames) < FEWEST_VIEWS or scene.layout not in OF_PHOTOS:
        return
    if scene.surrounded:
        yield from _flat_ground(frames)
        return
    around = [frame.border > 0.5 for frame in frames]
    hollow = [frame.border > 0.5 > frame.middle for frame in frames]
    holes = sum(1 - frame.whole for frame in frames) / len(frames)
    if sum(hollow) / len(frames) >= MOST_VIEWS:
        yield (
            f"coverage reaches the border of {sum(around)} of {len(frames)} views and misses the middle: if black masks"
            " the object, they are inverted: exchange black and white; if it hides what does not belong to the scene,"
            " say --masks ignore"
        )
    elif sum(around) / len(frames) >= MOST_VIEWS and holes > FEWEST_HOLES and "masks" not in scene.options:
        yield (
            f"coverage reaches the border of {sum(around)} of {len(frames)} views and has holes: does black in masks"
            " hide what does not belong to the scene (--masks ignore), or is nothing there (--masks object)?"
        )


def _flat_ground(frames: Sequence[Frame]) -> Iterator[str]:
    flat = [frame for frame in frames if frame.flat >= MOST_PIXELS]
    if len(flat) < MOST_VIEWS * len(frames):
        return
    colours = torch.stack([frame.colour for frame in flat])
    ground = colours.median(0).values
    alike = ((colours - ground).abs().amax(-1) <= ONE_COLOUR).float().mean()
    if float(alike) < MOST_VIEWS:
        return
    name = "white" if float(ground.min()) > 1 - ONE_COLOUR else "black" if float(ground.max()) < ONE_COLOUR else ""
    named = name or "display sRGB " + ", ".join(f"{float(level):.2f}" for level in ground)
    yield (
        f"the border of {len(flat)} of {len(frames)} views is one colour ({named}), and there are no masks: the ground"
        " is learnt as surfaces around the object, which cannot be relit; give masks (--mask-folder DIR), or images"
        " with an alpha"
    )
