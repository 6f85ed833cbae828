"""How well the training images determine what was recovered: docs/what_images_determine.md derives the criterion."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from scipy.special import stdtrit
from torch import Tensor

from radiogs_core.capabilities import QUANTITIES, Nuisance, Variable, Varying, VaryingFreely
from radiogs_core.contract import Trained
from radiogs_core.errors import NumericalFailure
from radiogs_core.scene.scene import Scene, View

from ..method_calls import calling, own_camera, refused, require
from ..store.schema import Determined
from .score_maps import coverage, truth

STEPS = {
    "roughness": 0.1,
    "roughness variation": 1.0,
    "brightness": math.log(1.25),
    "brightness, albedo free": math.log(1.25),
}
"""Amount by which each quantity is changed, which is also its required accuracy: a tenth of roughness's range, all of
the recovered variation, a quarter of the brightness."""

VIEWS = 8
"""Most training views that are compared."""

HALF_A_LEVEL = (0.5 / 255) ** 2
"""Mean squared change of an image below which most of its pixels keep their value in 8 bits."""

ROUNDING = 1 / 255**2 / 12
"""Mean squared error of an image caused by storage in 8 bits."""

CONFIDENCE = 0.95

PRODUCTS = 6
"""Most products with the Jacobian, and with its transpose, for the least-squares answer."""

DAMPING = 0.01
"""Tikhonov damping: the cost of an answer that changes every nuisance parameter by its unit, in ``HALF_A_LEVEL``. It
selects the smallest answer where several hide a change alike."""

SHORTENED = (1.0, 0.5)
"""Factors of the linearised answer for which images are rendered."""

Error = Sequence[float]
"""Squared error of each view in display sRGB, averaged over channels: the sum over the frame per covered pixel."""


def determined(
    trained: Trained, scene: Scene, device: torch.device, method: str, still_there: Callable[[], None] = lambda: None
) -> dict[str, Determined]:
    """Tests each quantity that can be changed for showing the trained model; empty if the model offers none.

    ``still_there`` is called after each change and may raise to stop. Raises MethodFailed for an exception of the
    method and for images of another number or size than the cameras, NumericalFailure for one that is not finite.
    """
    if not isinstance(trained, Variable):
        return {}
    views = spread_over(scene.train, VIEWS)
    with calling(method, "varying()"):
        model = trained.varying([own_camera(view.camera.to(device, torch.float32)) for view in views])
    require(method, model, Varying, "varying()")
    with calling(method, "values of varying()"):
        values = dict(model.values)
    found: dict[str, Determined] = {}
    for quantity in (name for name in QUANTITIES if name in values):
        shown, errors = [], []
        for amount in (0.0, STEPS[quantity], -STEPS[quantity]):
            with calling(method, f"images() with {quantity} changed by {amount:g}"):
                shown.append(list(model.images(quantity, amount)))
            errors.append(_errors(method, shown[-1], views))
            still_there()
        held = from_errors(values[quantity], STEPS[quantity], *errors)
        if isinstance(model, VaryingFreely):
            rise = held["rise"]
            if rise > HALF_A_LEVEL:
                with calling(method, f"nuisance() of {quantity}"):
                    rise = min(
                        rise, free_rise(model.nuisance(quantity), STEPS[quantity], shown, Comparison.over(views))
                    )
                if not math.isfinite(rise):
                    raise NumericalFailure(f"{method} showed an image that is not finite, with {quantity} changed")
                still_there()
            held = with_free_rise(held, rise)
        found[quantity] = held
    return found


Images = Sequence[Float[Tensor, "height width 3"]]
"""One image of each view, display sRGB."""


@dataclass(frozen=True)
class Comparison:
    """The norm by which changes of images count: squared, the change per covered pixel, mean over views."""

    weights: Sequence[float]
    """Factor of each view's values."""
    sizes: Sequence[tuple[int, int]]
    """Height and width of each view."""

    @classmethod
    def over(cls, views: Sequence[View]) -> "Comparison":
        """The norm for images of these views."""
        covered = [float((coverage(view)[..., 0] > 0).sum().clamp(min=1)) for view in views]
        sizes = [(view.camera.height, view.camera.width) for view in views]
        return cls([(each * len(views) * 3) ** -0.5 for each in covered], sizes)

    def vector(self, images: Images) -> Float[Tensor, " values"]:
        """All weighted values as one vector."""
        return torch.cat([weight * image.flatten() for weight, image in zip(self.weights, images, strict=True)])

    def images(self, vector: Float[Tensor, " values"]) -> list[Float[Tensor, "height width 3"]]:
        """The transpose of ``vector``."""
        parts = vector.split([height * width * 3 for height, width in self.sizes])
        sized = zip(self.weights, self.sizes, parts, strict=True)
        return [weight * part.view(*size, 3) for weight, size, part in sized]


def free_rise(nuisance: Nuisance, step: float, shown: Sequence[Images], comparison: Comparison) -> float:
    """Upper bound on the rise that a step causes while everything else may compensate: mean of a step up and down.

    ``shown``: the images as recovered, a step above, and a step below. The least-squares answer of the linearised
    images compensates the step up, its negative the step down, the whole or a part of it. The images are then rendered
    with it, so that the result bounds the least mean squared change from above however good the linearisation is.
    """
    here, above, below = (comparison.vector(images) for images in shown)
    answer = least_squares_answer(nuisance, (below - above) / 2, comparison)
    changes = []
    for sign, there in ((1.0, above), (-1.0, below)):
        least = float((there - here).square().sum())
        for factor in SHORTENED:
            if least > HALF_A_LEVEL:
                answered = comparison.vector(nuisance.images(sign * step, sign * factor * answer))
                least = min(least, float((answered - here).square().sum()))
        changes.append(least)
    return math.fsum(changes) / len(changes)


def least_squares_answer(
    nuisance: Nuisance, wanted: Float[Tensor, " values"], comparison: Comparison
) -> Float[Tensor, " parameters"]:
    """The answer whose linearised change is nearest to ``wanted``, damped, after ``PRODUCTS`` steps of CGLS.

    Conjugate gradients on the normal equations of |J x - wanted|^2 + damping |x|^2, from zero (Bjorck, Numerical
    Methods for Least Squares Problems, 1996, section 7.4).
    """
    scale, answer = nuisance.scale, nuisance.like
    damping = DAMPING * HALF_A_LEVEL / max(1, len(answer)) * scale.square()
    left = wanted
    gradient = direction = scale * nuisance.pull(comparison.images(left))
    size = float(gradient.square().sum())
    for _ in range(PRODUCTS):
        change = comparison.vector(nuisance.change(scale * direction))
        bend = float(change.square().sum() + (damping * direction.square()).sum())
        if size == 0 or bend == 0:
            break
        answer, left = answer + size / bend * direction, left - size / bend * change
        gradient = scale * nuisance.pull(comparison.images(left)) - damping * answer
        before, size = size, float(gradient.square().sum())
        direction = gradient + size / before * direction
    return scale * answer


def with_free_rise(held: Determined, rise: float) -> Determined:
    """The record with ``rise_free``: a step that everything else can hide leaves the quantity undetermined."""
    return {
        **held,
        "rise_free": rise,
        "decibels_free": decibels(held["error"], rise),
        "determined": held["determined"] and rise > HALF_A_LEVEL,
    }


def from_errors(value: float, step: float, here: Error, above: Error, below: Error) -> Determined:
    """Tests a quantity by three errors of each view: as recovered, and a step above and below.

    A parabola runs through the three. Half its second difference is the rise that a step causes from the lowest point;
    for small steps it is the mean squared change of the image, whatever the image's error. The lowest point of the sum
    over views is the views' estimate of the quantity, and the jackknife over views measures their agreement.
    """
    rises = [(up + down) / 2 - middle for middle, up, down in zip(here, above, below, strict=True)]
    slopes = [(up - down) / 2 for up, down in zip(above, below, strict=True)]
    error, rise = math.fsum(here) / len(here), math.fsum(rises) / len(rises)
    offset, half_width = _lowest(slopes, rises) if rise > HALF_A_LEVEL else (None, None)
    return Determined(
        value=value,
        step=step,
        views=len(rises),
        error=error,
        rise=rise,
        decibels=decibels(error, rise),
        offset=None if offset is None else offset * step,
        half_width=None if half_width is None else half_width * step,
        determined=offset is not None and half_width is not None and abs(offset) + half_width <= 1,
    )


def shown_by_images(record: Determined) -> bool:
    """Whether a step changes the images by more than half a level of 8 bits, with everything else free where known."""
    return record.get("rise_free", record["rise"]) > HALF_A_LEVEL


def decibels(error: float, rise: float) -> float:
    """The rise of a mean squared error in dB; errors count as at least the rounding of 8 bits."""
    return 10 * math.log10(max(error + rise, ROUNDING) / max(error, ROUNDING))


def _lowest(slopes: Sequence[float], rises: Sequence[float]) -> tuple[float | None, float | None]:
    """Where the views' summed parabola is lowest, in steps, and half the width of its jackknife t interval.

    None where it has no lowest point, and no width where that is so without one of the views, or for a single view.
    """
    count, slope, rise = len(rises), math.fsum(slopes), math.fsum(rises)
    if rise <= 0:
        return None, None
    offset = -slope / (2 * rise)
    without = [(slope - s, rise - r) for s, r in zip(slopes, rises, strict=True)]
    if count < 2 or any(remaining <= 0 for _, remaining in without):
        return offset, None
    offsets = [-s / (2 * r) for s, r in without]
    middle = math.fsum(offsets) / count
    deviation = math.sqrt((count - 1) / count * math.fsum((each - middle) ** 2 for each in offsets))
    return offset, float(stdtrit(count - 1, (1 + CONFIDENCE) / 2)) * deviation


def spread_over(views: Sequence[View], most: int) -> Sequence[View]:
    """At most so many views, evenly spread over their list."""
    return [views[index * len(views) // most] for index in range(most)] if len(views) > most else views


def _errors(method: str, images: Sequence[Float[Tensor, "height width 3"]], views: Sequence[View]) -> list[float]:
    sizes = [(view.camera.height, view.camera.width, 3) for view in views]
    given = [tuple(image.shape) for image in images]
    if given != sizes:
        raise refused(method, f"images() gave images of {given}", f"The cameras ask for {sizes}.")
    found = []
    for image, view in zip(images, views, strict=True):
        error = (image.detach().cpu().double() - truth(view, "image").double()).square().mean(-1)
        covered = coverage(view)[..., 0] > 0
        found.append(float(error.sum() / covered.sum().clamp(min=1)))
        if not math.isfinite(found[-1]):
            raise NumericalFailure(f"{method} showed an image that is not finite, of view '{view.name}'")
    return found
