"""The conventions in which published evaluations differ, one small type per metric.

Two values are comparable if every field agrees. Fields are words, because results record them. ``docs/protocols.md``
lists which code uses which, and where.
"""

from dataclasses import dataclass
from typing import Literal

Net = Literal["alex", "vgg", "squeeze"]
"""Backbones of LPIPS: torchvision's AlexNet, VGG16 and SqueezeNet 1.1."""

Bits = Literal["float", "8 bit rounded", "8 bit truncated"]
"""Whether an image passes through 8 bits before it is compared, and how it gets there."""

Space = Literal["linear", "srgb", "gamma 2.2"]
"""Encoding in which linear albedo is compared."""

Task = Literal["nvs", "relight", "indirect"]
"""The subject of an image: a new view, a new light, or the radiance that has met two or more surfaces."""


@dataclass(frozen=True)
class Picture:
    """How prediction and truth are laid out before they are compared. Both come on black with their coverage.

    ``prediction``: as rendered over the background; the same times the true coverage; its straight colour where it
    covers more than half and the background elsewhere ("solid"); or the background wherever the truth covers nothing.
    ``target``: composited over the background; the same times its coverage once more; or straight, never multiplied.
    "display times true coverage" and "composited in display" multiply the display values of a linear map, on black;
    "composited in display, times coverage again" multiplies the linear map once more. ``clipped``: the prediction is
    clipped to [0, 1].
    """

    background: Literal["black", "white"] = "black"
    prediction: Literal[
        "rendered", "times true coverage", "display times true coverage", "solid", "background outside truth"
    ] = "rendered"
    target: Literal[
        "composited", "times coverage again", "composited in display", "composited in display, times coverage again",
        "straight",
    ] = "composited"  # fmt: skip
    clipped: bool = True
    prediction_bits: Bits = "float"
    target_bits: Bits = "float"


@dataclass(frozen=True)
class Psnr:
    """Peak 1. Over all channels jointly, or the mean of one PSNR per channel (never lower, by convexity).

    ``albedo_views``: whether the albedo of all views is one error ("pooled") or each view has its own.
    """

    channels: Literal["joint", "mean of channels"] = "joint"
    albedo_views: Literal["mean", "pooled"] = "mean"


@dataclass(frozen=True)
class Ssim:
    """Structural similarity, mean over pixels and channels; K1 = 0.01, K2 = 0.03.

    Gaussian taps have sigma 1.5. ``padding`` "valid" scores only windows inside the image. ``bounded`` clips
    variances at zero and the covariance at their geometric mean.
    """

    window: int = 11
    taps: Literal["gaussian", "uniform"] = "gaussian"
    padding: Literal["valid", "zero", "reflect"] = "valid"
    covariance: Literal["population", "sample"] = "population"
    bounded: bool = False
    data_range: float = 1.0


@dataclass(frozen=True)
class Lpips:
    """LPIPS v0.1. The network expects [-1, 1]; several codes feed it [0, 1], which is another metric."""

    net: Net = "alex"
    input: Literal["[-1, 1]", "[0, 1]"] = "[-1, 1]"


@dataclass(frozen=True)
class Normal:
    """Angular error in degrees, from atan2.

    ``region`` "mask" averages where the truth covers more than half, and a hole counts 90. ``region`` "image" averages
    over every pixel, after both sides are blended over (0, 0, 1), the prediction by the coverage ``blended_by`` names.
    ``lengths``: blended as unit vectors, or as the published renderers write them, with their own coverage as length,
    which then counts once more. ``measure`` "cosine" is Stanford-ORB's 1 - cos in the eroded mask instead.
    """

    measure: Literal["angle", "cosine"] = "angle"
    region: Literal["mask", "image", "eroded mask"] = "mask"
    blended_by: Literal["own coverage", "true coverage"] = "own coverage"
    lengths: Literal["unit", "own coverage"] = "unit"
    prediction_bits: Bits = "float"


@dataclass(frozen=True)
class Albedo:
    """Alignment of the recovered albedo, which is known only up to a factor per channel, and its comparison.

    ``align``: the statistic of truth / prediction that gives the factor; ``fitted_to``: the views that it is taken
    over; ``pixels``: the pixels that count, "solid" where the truth covers more than half and is positive in all
    channels, "covered" where it covers anything and is positive in all channels, "covered, any truth" where it covers
    anything, "predicted" where the prediction is positive in all channels. ``fitted_target``: the truth that the factor
    is fitted to, as ``Picture.target``. ``largest`` bounds each pixel's ratio. ``scaled``: the pixels that the factor
    multiplies, all or those that the truth covers. ``relights``: whether relighting uses the aligned albedo.
    ``difference``: the perceived difference of colours that is measured as well, inside the mask.
    """

    align: Literal["none", "first channel's median", "median", "mean", "least squares"] = "median"
    fitted_to: Literal["all views", "first view", "20 views", "each view"] = "all views"
    pixels: Literal["solid", "covered", "covered, any truth", "predicted", "eroded mask"] = "solid"
    fitted_target: Literal["composited", "composited in display", "straight"] = "composited"
    largest: float | None = None
    scaled: Literal["everywhere", "covered"] = "everywhere"
    psnr_space: Space = "linear"
    structure_space: Space = "linear"
    picture: Picture = Picture()
    relights: bool = True
    difference: Literal["none", "CIEDE2000"] = "none"


@dataclass(frozen=True)
class Roughness:
    """Mean squared error where the truth covers more than half, or over the image with zeros for the background.

    Over the image the prediction is multiplied by the true coverage. ``target``: the truth as ``Picture.target``.
    """

    region: Literal["mask", "image"] = "mask"
    target: Literal["composited", "times coverage again"] = "composited"


@dataclass(frozen=True)
class Indirect:
    """Which indirect light is compared, as display sRGB on black.

    "outgoing": radiance towards the camera after two or more surfaces. "incident": the released RadioGS code's mean
    over the hemisphere's samples of what arrives, without cosine and albedo.
    """

    quantity: Literal["outgoing", "incident"] = "outgoing"
    picture: Picture = Picture()


@dataclass(frozen=True)
class Depth:
    """Scale-invariant squared error of z-depth: one least-squares factor per capture, or per view."""

    scale: Literal["all views", "each view"] = "all views"


@dataclass(frozen=True)
class DepthOffset:
    """Mean absolute difference of z-depth where the truth covers more than ``covered`` of a pixel, without a scale.

    In percent of the scene's extent (``Scene.extent``).
    """

    covered: float = 0.5


@dataclass(frozen=True)
class Environment:
    """Squared error of the recovered light over the squared true light, by texel, irradiance or reflection.

    ``scale`` is the least-squares factor, which is applied before the comparison.
    """

    scale: Literal["none", "one factor", "factor a channel"] = "factor a channel"
