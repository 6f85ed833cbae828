"""How little a scene shows, in sentences: what its images cannot say, metrics of them cannot mean."""

import hashlib
from collections import defaultdict
from collections.abc import Iterator

import torch

from radiogs_core.scene.scene import Scene, View

SSIM_WINDOW = 11
"""Pixels of the window that SSIM compares: a smaller image has none."""

FEWEST_VIEWS = 3
"""Training views from which on a point is seen from two sides by more than chance."""

FEWEST_PIXELS = 64
"""Covered pixels of a view below which its values are those of a few."""


def few_views_or_pixels(scene: Scene) -> tuple[str, ...]:
    """What cameras alone tell: few training views or test views, all from one place, images below SSIM's window."""
    said = []
    if 0 < len(scene.train) < FEWEST_VIEWS:
        said.append(f"{_views(len(scene.train))} to learn from: shape, light and materials are not determined")
    elif scene.train and scene.extent == 0:
        said.append("all training cameras stand in one place: depth is not determined")
    if len(scene.test) == 1:
        said.append("1 view to score: its metrics are of that view alone")
    small = [view for view in scene.test if min(view.camera.height, view.camera.width) < SSIM_WINDOW]
    if small:
        said.append(
            f"{_views(len(small))} to score with less than {SSIM_WINDOW} pixels a side: SSIM has no value there"
        )
    return tuple(said)


def little_evidence(views: Iterator[tuple[View, torch.Tensor, torch.Tensor | None]]) -> Iterator[tuple[str, str]]:
    """Of views with their image and alpha: (view, sentence) for images of one colour, hardly covered, or alike."""
    alike: dict[bytes, list[str]] = defaultdict(list)
    for view, image, alpha in views:
        seen = image if alpha is None else image[alpha[..., 0] > 0]
        if seen.numel() and float(seen.max()) == float(seen.min()):
            level = {0.0: "black", 1.0: "white"}.get(float(seen.max()), "one colour")
            yield view.name, f"its image is {level} throughout: nothing can be learnt or scored from it"
        covered = None if alpha is None else int((alpha > 0.5).sum())
        if covered is not None and covered < FEWEST_PIXELS:
            yield view.name, f"{covered} of its pixels show the object: its metrics are those of a few pixels"
        alike[hashlib.sha256(image.contiguous().numpy().tobytes()).digest()].append(view.name)
    for names in alike.values():
        if len(names) > 1:
            yield (
                names[1],
                f"its image is that of {names[0]}" + (f", as are {len(names) - 2} more" if names[2:] else ""),
            )


def _views(count: int) -> str:
    return "1 view" if count == 1 else f"{count} views"
