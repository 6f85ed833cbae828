"""Sentences on predictions that fit their truth far better when they are read in another way.

Codes differ in ground, order of views, transfer curve and axes, and files do not say which they have. The truth does:
each known alternative is tried, and one that explains most of the error is named. No value is changed. Images that are
merely bad (noise, blur, a coarse model) fit no alternative better, and yield no sentence.
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
"""Degrees by which normals in other axes have to fit better, and the largest remaining error."""

MOST_NORMALS, MOST_PIXELS = 4000, 20_000
"""Most normals compared per view, and most pixels to which a power is fitted, evenly spaced."""


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
    on_black = [pair.image - colour * (1 - pair.mask) for pair in pairs]
    gain = float((_fit(on_black, pairs) - _fit([pair.image for pair in pairs], pairs)).mean())
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


def _fit(images: Sequence[Image], pairs: Sequence[Pair]) -> Float[np.ndarray, " views"]:
    """PSNR of each image against its truth, dB."""
    errors = [float((image - pair.target).square().mean()) for image, pair in zip(images, pairs, strict=True)]
    return np.array([decibel(error) for error in errors])


def _order(what: str, views: Sequence[View], predictions: Predictions, name: str, ground: Float[Tensor, "3"]) -> str:
    """A sentence if images fit the truth of other views far better; both are compared on the images' own ground."""
    given, wanted = [], []
    for view in views:
        pair = _pair(predictions, view, name)
        removed = 1.0 if predictions.on_white(name, view) else 0.0
        given.append(_thumbnail(pair.image + removed * (1 - pair.mask)))
        wanted.append(_thumbnail(pair.target + (ground + removed) * (1 - pair.mask)))
    ours, theirs = torch.stack(given).flatten(1), torch.stack(wanted).flatten(1)
    errors = np.stack([(theirs - each).square().mean(1).double().numpy() for each in ours])
    fits: list[int] = linear_sum_assignment(errors)[1].tolist()
    gains = [decibel(errors[place, fit]) - decibel(errors[place, place]) for place, fit in enumerate(fits)]
    moved = [place for place, gain in enumerate(gains) if gain >= FAR_BETTER]
    if not moved:
        return ""
    by = f"by {math.fsum(gains[place] for place in moved) / len(moved):.0f} dB"
    if len(moved) == 2 and fits[moved[0]] == moved[1]:
        first, second = (views[place].name for place in moved)
        said = f"views {first} and {second} fit each other's truth better, {by}"
    else:
        each = [f"{views[place].name} that of {views[fits[place]].name}" for place in moved]
        more = f", and {len(each) - NAMED_VIEWS} more" if len(each) > NAMED_VIEWS else ""
        said = f"{len(moved)} views fit the truth of other views better, {by} ({', '.join(each[:NAMED_VIEWS])}{more})"
    return f"{what}: {said}: are the files in the order of the scene's test views?"


def _thumbnail(image: Image) -> Float[Tensor, "side side 3"]:
    channels = image.float().permute(2, 0, 1)[None]
    return torch.nn.functional.adaptive_avg_pool2d(channels, THUMBNAIL)[0].permute(1, 2, 0)


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
    plain = _fit(_aligned(images, pairs, linear), pairs)
    others = () if linear else (_exposed(images, pairs), _gamma(images, pairs))
    fitted = sorted(((said, _fit(found, pairs)) for said, found in others), key=lambda each: -each[1].mean())
    readings = [*AXES, *CURVES[linear]]
    fixed = [_fit(_aligned([read(image) for image in images], pairs, linear), pairs) for _, read in readings]
    best = max(range(len(readings)), key=lambda place: fixed[place].mean())
    gain = FAR_BETTER if best < len(AXES) else FAR_BETTER_CURVE
    least = max(RECOGNISED, fitted[0][1].mean() - 1) if fitted else RECOGNISED
    tried = [(readings[best][0], fixed[best], least, gain)]
    tried += [(said, fit, RECOGNISED_FITTED, FAR_BETTER_CURVE) for said, fit in fitted]
    for said, fit, least, gain in tried:
        gains = fit - plain
        # By ``gain`` dB in the mean, and by half of it in nearly all views.
        if fit.mean() >= least and gains.mean() >= gain and (gains >= gain / 2).mean() >= IN_MOST_VIEWS:
            return [f"{what}: {said} they fit {fit.mean() - plain.mean():.0f} dB better"]
    return []


def _aligned(images: list[Image], pairs: Sequence[Pair], linear: bool) -> list[Image]:
    """Linear maps, each channel times its least-squares factor: albedo is known only up to that factor."""
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
    """Evenly spaced pixels, fewer than twice MOST_PIXELS."""
    return image.flatten(0, 1)[:: max(1, image[..., 0].numel() // MOST_PIXELS)]


def _of_normals(views: Sequence[View], predictions: Predictions) -> list[str]:
    """A sentence if normals fit far better with their components exchanged or negated, in the world or the camera."""
    seen = [each for view in _spaced(views) if len((each := _normals(predictions, view))[0])]
    if not seen:
        return []
    plain = np.array([_degrees(found, true) for found, true, _ in seen])
    best, sentence = plain, ""
    for order, signs, in_camera in itertools.product(
        itertools.permutations(range(3)), itertools.product((1.0, -1.0), repeat=3), (False, True)
    ):
        errors = []
        for found, true, axes in seen:
            turned = found[:, order] * torch.tensor(signs)
            errors.append(_degrees(turned @ axes.T if in_camera else turned, true))
        if sum(errors) < best.sum():
            best, sentence = np.array(errors), _axes_in_words(order, signs, in_camera)
    before, after, gains = plain.mean(), best.mean(), plain - best
    if gains.mean() < TURNED or after > min(MOST_LEFT, before / 2) or (gains >= TURNED / 2).mean() < IN_MOST_VIEWS:
        return []
    return [
        f"normals: {sentence} they are {after:.0f} degrees off instead of {before:.0f}: write them in the world's axes"
    ]


def _normals(
    predictions: Predictions, view: View
) -> tuple[Float[Tensor, "pixels 3"], Float[Tensor, "pixels 3"], Float[Tensor, "3 3"]]:
    """Predicted and true unit normals of a view's pixels, in the world, and the camera's axes as columns."""
    pair = _pair(predictions, view, "normal")
    both = (pair.image.norm(dim=-1) > 0.5) & (pair.target.norm(dim=-1) > 0.5) & (pair.mask[..., 0] > 0.5)
    every = max(1, int(both.sum()) // MOST_NORMALS)
    return pair.image[both][::every], pair.target[both][::every], view.camera.axes.float()


def _degrees(found: Float[Tensor, "pixels 3"], true: Float[Tensor, "pixels 3"]) -> float:
    cosine = torch.nn.functional.cosine_similarity(found, true, dim=-1).clamp(-1, 1)
    return float(torch.rad2deg(torch.acos(cosine)).mean())


def _axes_in_words(order: Sequence[int], signs: Sequence[float], in_camera: bool) -> str:
    """The file's components, in words, for each axis of the world, or for each camera's right, down and forward."""
    parts = ["-" * (sign < 0) + "xyz"[place] for place, sign in zip(order, signs, strict=True)]
    where = "right, down and forward of each camera" if in_camera else "x, y and z of the world"
    return f"with ({', '.join(parts)}) of the file for {where}"
