"""Sentences on predictions that fit their truth far better when they are read in another way.

Codes differ in ground, order of views, transfer curve and axes, and files do not say which they have. The truth does:
each known alternative is tried, and one that explains most of the error is named. No value is changed by it. Images
that are merely bad (noise, blur, a coarse model) fit none of them better, and nothing is said.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from radiogs_baselines.outputs.predictions import Predictions
from radiogs_core.scene.colour import srgb_decode, srgb_encode
from radiogs_core.scene.scene import Scene, View

from .metrics.psnr import decibel
from .score_maps import coverage, truth

Image = Float[Tensor, "height width 3"]

FAR_BETTER, FAR_BETTER_CURVE = 6.0, 10.0
"""Gains in dB from which another order of views, pixels or channels is named, and another curve or a fitted number."""

RECOGNISED, RECOGNISED_FITTED = 15.0, 25.0
"""PSNR in dB that an alternative has to reach, without and with a fitted number: below, nothing explains the images."""

IN_MOST_VIEWS = 0.9
"""Share of the views in which an alternative has to fit better."""

MOST_VIEWS = 8
"""Views that are looked at, evenly spaced; the order is looked for among all."""

THUMBNAIL = 32
"""Pixels a side of the means that are compared for the order of views."""

NAMED_VIEWS = 6
"""Views in another order that a sentence names."""

GROUND_SPREAD = 0.1
"""Largest difference in display values from a ground of one colour."""

TURNED, MOST_LEFT = 15.0, 30.0
"""Degrees by which normals in other axes have to fit better, and the most that may be left."""

MOST_NORMALS, MOST_PIXELS = 4000, 20_000
"""Normals of a view that are looked at, and pixels by which a power is fitted, evenly spaced."""


@dataclass(frozen=True)
class Pair:
    """A predicted image and its truth, both on black, display sRGB or linear as the map has it."""

    image: Image
    target: Image
    mask: Float[Tensor, "height width 1"]
    """True coverage."""


def with_other_readings(predictions: Predictions, scene: Scene) -> Predictions:
    """The predictions with the sentences of ``other_readings`` first among their remarks."""
    return replace(predictions, remarks=(*other_readings(predictions, scene), *predictions.remarks))


def other_readings(predictions: Predictions, scene: Scene) -> list[str]:
    """A sentence for each map that fits its truth far better in another reading; the files are read once more.

    Looked at are images, relit images, albedo and normals of the test views. Raises DataError as ``Predictions.read``.
    """
    kinds: dict[str, list[View]] = {
        name: [view for view in scene.test if view.has(name) and name in predictions.maps.get(view.name, {})]
        for name in ("image", "albedo", "normal")
    }
    found = _of_colours("images", kinds["image"], predictions, "image")
    if not scene.surrounded:
        found += _of_colours("albedo", kinds["albedo"], predictions, "albedo")
        for light, files in predictions.relit.items():
            views = [view for view in scene.test if view.name in files and view.has(f"relit/{light}")]
            found += _of_colours(f"images relit under {light}", views, predictions, f"relit/{light}")
    return [*found, *_of_normals(kinds["normal"], predictions)]


def _spaced(views: Sequence[View]) -> list[View]:
    places = np.unique(np.linspace(0, len(views) - 1, min(len(views), MOST_VIEWS)).round().astype(int))
    return [views[place] for place in places] if views else []


def _of_colours(what: str, views: Sequence[View], predictions: Predictions, name: str) -> list[str]:
    """Sentences on a map of colours: its ground, the order of its views, and how its values and axes are read."""
    if not views:
        return []
    pairs = [_pair(predictions, view, name) for view in _spaced(views)]
    ground, said = _ground(what, pairs)
    order = _order(what, views, predictions, name, ground)
    if order:
        return [*said, order]
    pairs = [replace(pair, image=pair.image - ground * (1 - pair.mask)) for pair in pairs]
    return [*said, *_values(what, pairs, linear=name == "albedo")]


def _pair(predictions: Predictions, view: View, name: str) -> Pair:
    mask = coverage(view)
    return Pair(predictions.read_one(name, view, mask), truth(view, name), mask)


def _ground(what: str, pairs: Sequence[Pair]) -> tuple[Float[Tensor, "3"], list[str]]:
    """The colour that most images have where the scene has nothing, and a sentence if it is not black."""
    black = torch.zeros(3)
    outside = [image for pair in pairs if len(image := pair.image[pair.mask[..., 0] == 0]) >= MOST_VIEWS]
    if len(outside) < len(pairs) / 2:
        return black, []
    colour = torch.cat(outside).median(0).values
    shares = [float(((each - colour).abs() <= GROUND_SPREAD).all(-1).float().mean()) for each in outside]
    uniform = sorted(shares)[len(shares) // 2] > 0.75
    gain = _mean_gain([pair.image for pair in pairs], [p.image - colour * (1 - p.mask) for p in pairs], pairs)
    if not uniform or float(colour.abs().max()) < GROUND_SPREAD:
        return black, []
    for name, level in (("white", 1.0), ("black", -1.0)):  # black where the layout has taken a white ground away
        if float((colour - level).abs().max()) <= GROUND_SPREAD and gain > 0:
            return torch.full((3,), level), [f"on a {name} ground the {what} fit {gain:.0f} dB better: --ground {name}"]
    if gain < FAR_BETTER:
        return black, []
    shown = ", ".join(f"{float(each):.2f}" for each in colour)
    sentence = f"where the scene has nothing, the {what} are ({shown}); on black they fit {gain:.0f} dB better"
    return colour, [f"{sentence}: write them on black, or with coverage as a fourth channel"]


def _errors(images: Sequence[Image], pairs: Sequence[Pair]) -> list[float]:
    return [float((image - pair.target).square().mean()) for image, pair in zip(images, pairs, strict=True)]


def _mean_gain(before: Sequence[Image], after: Sequence[Image], pairs: Sequence[Pair]) -> float:
    """By how many dB the second images fit better, in the mean over views."""
    gains = [
        decibel(new) - decibel(old) for old, new in zip(_errors(before, pairs), _errors(after, pairs), strict=True)
    ]
    return math.fsum(gains) / len(gains)


def _order(what: str, views: Sequence[View], predictions: Predictions, name: str, ground: Float[Tensor, "3"]) -> str:
    """A sentence if images fit the truth of other views far better; both are compared on the images' own ground."""
    given, wanted = [], []
    for view in views:
        pair = _pair(predictions, view, name)
        removed = 1.0 if predictions.on_white(name, view) else 0.0
        given.append(_thumbnail(pair.image + removed * (1 - pair.mask)))
        wanted.append(_thumbnail(pair.target + (ground + removed) * (1 - pair.mask)))
    ours, theirs = torch.stack(given).flatten(1), torch.stack(wanted).flatten(1)
    errors = np.stack([(theirs - each).square().mean(1).numpy() for each in ours])
    fits: list[int] = linear_sum_assignment(errors)[1].tolist()
    moved = [place for cycle in _cycles(fits) if _cycle_gain(errors, fits, cycle) >= FAR_BETTER for place in cycle]
    if not moved:
        return ""
    gain = _cycle_gain(errors, fits, moved)
    if len(moved) == 2:
        first, second = (views[place].name for place in sorted(moved))
        said = f"views {first} and {second} fit each other's truth better, by {gain:.0f} dB"
    else:
        each = [f"{views[place].name} that of {views[fits[place]].name}" for place in sorted(moved)]
        more = f", and {len(each) - NAMED_VIEWS} more" if len(each) > NAMED_VIEWS else ""
        said = f"{len(moved)} views fit the truth of other views better, by {gain:.0f} dB"
        said += f" ({', '.join(each[:NAMED_VIEWS])}{more})"
    return f"{what}: {said}: are the files in the order of the scene's test views?"


def _thumbnail(image: Image) -> Float[Tensor, "side side 3"]:
    channels = image.float().permute(2, 0, 1)[None]
    return torch.nn.functional.adaptive_avg_pool2d(channels, THUMBNAIL)[0].permute(1, 2, 0)


def _cycles(fits: Sequence[int]) -> list[list[int]]:
    """The cycles of a permutation that have more than one place."""
    left, found = {place for place, other in enumerate(fits) if place != other}, []
    while left:
        cycle = [min(left)]
        while (following := fits[cycle[-1]]) != cycle[0]:
            cycle.append(following)
        left -= set(cycle)
        found.append(cycle)
    return found


def _cycle_gain(errors: np.ndarray, fits: Sequence[int], places: Sequence[int]) -> float:
    """By how many dB these views fit the truth that each is given better than its own."""
    own, other = (
        sum(errors[place, to] for place, to in zip(places, each, strict=True))
        for each in (places, [fits[place] for place in places])
    )
    return decibel(float(other) / len(places)) - decibel(float(own) / len(places))


Reading = Callable[[Image], Image]

AXES: tuple[tuple[str, Reading], ...] = (
    ("with red and blue exchanged", lambda image: image.flip(-1)),
    ("upside down", lambda image: image.flip(0)),
    ("mirrored left to right", lambda image: image.flip(1)),
    ("turned by half a turn", lambda image: image.flip(0, 1)),
)
CURVES: dict[bool, tuple[tuple[str, Reading], ...]] = {
    False: (
        ("taken for linear values and converted to sRGB", srgb_encode),
        ("with one sRGB curve taken away (it was applied twice)", lambda image: srgb_decode(image.clamp(min=0))),
    ),
    True: (
        ("taken for sRGB values and converted to linear ones", lambda image: srgb_decode(image.clamp(min=0))),
        ("without the conversion from sRGB (the file is linear)", srgb_encode),
    ),
}
"""Readings by whether the map is linear."""


def _values(what: str, pairs: Sequence[Pair], *, linear: bool) -> list[str]:
    """A sentence if another order of channels or pixels, another curve, or one number fits the values far better."""
    images = [pair.image for pair in pairs]
    plain = _errors(_aligned(images, pairs, linear), pairs)
    readings = [*AXES, *CURVES[linear]]
    fixed = [_errors(_aligned([read(image) for image in images], pairs, linear), pairs) for _, read in readings]
    fitted = [] if linear else [_exposed(images, pairs), _gamma(images, pairs)]
    limit = max((_level(_errors(found, pairs)) for _, found in fitted), default=-math.inf) - 1
    best = max(range(len(readings)), key=lambda place: _level(fixed[place]))
    needed = FAR_BETTER if best < len(AXES) else FAR_BETTER_CURVE
    if _level(fixed[best]) >= max(limit, RECOGNISED) and _far_better(plain, fixed[best], needed):
        gain = _level(fixed[best]) - _level(plain)
        return [f"{what}: {readings[best][0]} they fit {gain:.0f} dB better"]
    for said, found in sorted(fitted, key=lambda each: -_level(_errors(each[1], pairs))):
        errors = _errors(found, pairs)
        if _level(errors) >= RECOGNISED_FITTED and _far_better(plain, errors, FAR_BETTER_CURVE):
            return [f"{what}: {said} they fit {_level(errors) - _level(plain):.0f} dB better"]
    return []


def _level(errors: Sequence[float]) -> float:
    return math.fsum(map(decibel, errors)) / len(errors)


def _far_better(before: Sequence[float], after: Sequence[float], gain: float) -> bool:
    """Whether errors have fallen by ``gain`` dB in the mean, and by half of it in nearly all views."""
    gains = [decibel(new) - decibel(old) for old, new in zip(before, after, strict=True)]
    return math.fsum(gains) >= gain * len(gains) and sum(g >= gain / 2 for g in gains) >= IN_MOST_VIEWS * len(gains)


def _aligned(images: list[Image], pairs: Sequence[Pair], linear: bool) -> list[Image]:
    """Linear maps times the factor of each channel that fits best: albedo is known only up to it."""
    if not linear:
        return images
    top = sum((i * p.target).double().sum((0, 1)) for i, p in zip(images, pairs, strict=True))
    bottom = sum(i.double().square().sum((0, 1)) for i in images)
    factor = torch.as_tensor(top / torch.as_tensor(bottom).clamp(min=1e-12)).float()
    return [image * factor for image in images]


def _exposed(images: list[Image], pairs: Sequence[Pair]) -> tuple[str, list[Image]]:
    """The images under the exposure that fits best, fitted in linear light."""
    ours = torch.cat([srgb_decode(image.clamp(0, 1)).flatten() for image in images]).double()
    theirs = torch.cat([srgb_decode(pair.target).flatten() for pair in pairs]).double()
    factor = float((ours @ theirs) / (ours @ ours).clamp(min=1e-12))
    found = [srgb_encode(factor * srgb_decode(image.clamp(0, 1))).clamp(0, 1) for image in images]
    return f"times {factor:.3g} in linear light", found


def _gamma(images: list[Image], pairs: Sequence[Pair]) -> tuple[str, list[Image]]:
    """The images to the power that fits best."""
    some = [(_sampled(image).clamp(0, 1), _sampled(pair.target)) for image, pair in zip(images, pairs, strict=True)]
    powers = [2 ** (step / 10) for step in range(-17, 18)]
    best = min(powers, key=lambda power: sum(float((i**power - t).square().mean()) for i, t in some))
    return f"to the power {best:.2g}", [image.clamp(0, 1) ** best for image in images]


def _sampled(image: Image) -> Float[Tensor, "pixels 3"]:
    """Evenly spaced pixels, at most twice MOST_PIXELS of them."""
    return image.flatten(0, 1)[:: max(1, image[..., 0].numel() // MOST_PIXELS)]


@dataclass(frozen=True)
class Normals:
    """Predicted and true unit normals of a view's pixels, in the world, and the camera's axes as columns."""

    found: Float[Tensor, "pixels 3"]
    true: Float[Tensor, "pixels 3"]
    axes: Float[Tensor, "3 3"]


def _of_normals(views: Sequence[View], predictions: Predictions) -> list[str]:
    """A sentence if normals fit far better with their components exchanged or negated, in the world or the camera."""
    seen = [each for view in _spaced(views) if len((each := _normals(predictions, view)).found)]
    if not seen:
        return []
    plain = [_degrees(each.found, each.true) for each in seen]
    best, sentence = plain, ""
    for order, signs, in_camera in itertools.product(
        itertools.permutations(range(3)), itertools.product((1.0, -1.0), repeat=3), (False, True)
    ):
        errors = []
        for each in seen:
            turned = each.found[:, order] * torch.tensor(signs)
            errors.append(_degrees(turned @ each.axes.T if in_camera else turned, each.true))
        if sum(errors) < sum(best):
            best, sentence = errors, _axes_in_words(order, signs, in_camera)
    better = [old - new >= TURNED / 2 for old, new in zip(plain, best, strict=True)]
    before, after = sum(plain) / len(plain), sum(best) / len(best)
    if before - after < TURNED or after > min(MOST_LEFT, before / 2) or sum(better) < IN_MOST_VIEWS * len(better):
        return []
    return [
        f"normals: {sentence} they are {after:.0f} degrees off instead of {before:.0f}: write them in the world's axes"
    ]


def _normals(predictions: Predictions, view: View) -> Normals:
    pair = _pair(predictions, view, "normal")
    both = (pair.image.norm(dim=-1) > 0.5) & (pair.target.norm(dim=-1) > 0.5) & (pair.mask[..., 0] > 0.5)
    every = max(1, int(both.sum()) // MOST_NORMALS)
    return Normals(pair.image[both][::every], pair.target[both][::every], view.camera.axes.float())


def _degrees(found: Float[Tensor, "pixels 3"], true: Float[Tensor, "pixels 3"]) -> float:
    cosine = torch.nn.functional.cosine_similarity(found, true, dim=-1).clamp(-1, 1)
    return float(torch.rad2deg(torch.acos(cosine)).mean())


def _axes_in_words(order: Sequence[int], signs: Sequence[float], in_camera: bool) -> str:
    """Which components of the file are those of the world, or of the camera's right, down and forward."""
    parts = ["-" * (sign < 0) + "xyz"[place] for place, sign in zip(order, signs, strict=True)]
    where = "right, down and forward of each camera" if in_camera else "x, y and z of the world"
    return f"with ({', '.join(parts)}) of the file for {where}"
