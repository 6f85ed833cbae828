"""Every measure by name: how tables print it and, if it compares two pictures, its function."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from .pictures import Image


@dataclass(frozen=True)
class Measure:
    """How a kind of metric is labelled, printed and computed."""

    label: str
    """Heading of a column, after the task."""
    unit: str
    """Unit, empty for a number without one."""
    better: Literal["up", "down", "zero"]
    """Which direction is better."""
    decimals: int
    """Decimals in tables."""
    meaning: str
    """Definition, in words that ``Task.meaning`` continues."""
    compare: Callable[[Image, Image], float] | None = None
    """Computes it from a prediction and its truth, both [height, width, 3], as the protocol lays them out.

    Then every protocol scores it for new views, relit views, indirect light and albedo; NaN reads n/a. None for a
    measure that depends on more than two pictures.
    """


MEASURES: Mapping[str, Measure] = {
    "psnr": Measure("PSNR", "dB", "up", 2, "peak signal-to-noise ratio"),
    # A relit image against the one of the method's own reference.
    "psnr_reference": Measure(
        "PSNR to reference", "dB", "up", 2, "peak signal-to-noise ratio against the method's own reference"
    ),
    "ssim": Measure("SSIM", "", "up", 3, "structural similarity"),
    "lpips": Measure("LPIPS", "", "down", 3, "perceptual distance by the protocol's first network"),
    "mae": Measure("MAE", "deg", "down", 2, "mean angular error"),
    "mse": Measure("MSE", "", "down", 4, "mean squared error"),
    "delta_e": Measure("CIEDE2000", "", "down", 2, "mean colour difference CIEDE2000"),
    "ms": Measure("time", "ms", "down", 2, "milliseconds"),
    "megabytes": Measure("memory", "MB", "down", 1, "peak memory"),
    "bias": Measure("bias", "%", "zero", 2, "mean relative error with its sign"),
    # Stanford-ORB's own: two PSNRs, 1 - cos of normals, scale-invariant depth, distance of surfaces.
    "psnr_h": Measure("PSNR-H", "dB", "up", 2, "peak signal-to-noise ratio of tone-mapped HDR images"),
    "psnr_l": Measure("PSNR-L", "dB", "up", 2, "peak signal-to-noise ratio of display images"),
    "cosine": Measure("cosine distance", "", "down", 4, "mean of 1 - cos of the angle"),
    "simse": Measure("SI-MSE", "sq. unit", "down", 5, "scale-invariant mean squared error"),
    "offset": Measure("offset", "% of extent", "down", 2, "mean distance to the true surface along the ray"),
    "chamfer": Measure("chamfer", "sq. unit", "down", 6, "mean squared distance of surfaces, both ways"),
    # The network beside a protocol's first one is named.
    "lpips_alex": Measure("LPIPS (AlexNet)", "", "down", 3, "perceptual distance by AlexNet"),
    "lpips_vgg": Measure("LPIPS (VGG)", "", "down", 3, "perceptual distance by VGG16"),
    "lpips_squeeze": Measure("LPIPS (SqueezeNet)", "", "down", 3, "perceptual distance by SqueezeNet"),
    # A recovered environment map, as it is and after the protocol's alignment.
    "error": Measure("error", "", "down", 3, "relative error of radiance"),
    "error_scaled": Measure("error up to scale", "", "down", 3, "relative error of radiance after the best factor"),
    # Recovered light as surfaces in the test views receive it, and the error that its resolution alone costs.
    "irradiance": Measure(
        "error of irradiance", "", "down", 3, "relative error of the irradiance that surfaces of the test views receive"
    ),
    "reflection": Measure("error of reflections", "", "down", 3, "relative error of what their reflections show"),
    "floor": Measure("error of the truth at this resolution", "", "down", 3, "error that the resolution alone costs"),
    # The best map that is the same everywhere: a recovered one that is no better carries no information.
    "constant": Measure("error of a constant", "", "down", 4, "error of the best map that is the same everywhere"),
    # Float32 against float64, in units of its rounding, 1.19e-7.
    "safe": Measure(
        "error, safe range", "eps", "down", 1, "largest error of float32 in its safe range, in units of rounding"
    ),
    "hard": Measure(
        "error, hard end", "eps", "down", 1, "largest error of float32 at its hard end, in units of rounding"
    ),
    "share": Measure("share of the tolerance", "", "down", 3, "largest share of the tolerance that is used"),
    "fired": Measure("that acted", "times", "down", 0, "how many acted"),
    # Leaving out effects: traced rays, and what that may cost.
    "rays": Measure("rays", "M", "down", 2, "traced rays"),
    "seconds": Measure("duration", "s", "down", 1, "seconds"),
    "bound": Measure("bound on the loss", "dB", "down", 3, "predicted bound on what leaving effects out costs"),
    "worst": Measure("worst case", "dB", "down", 2, "largest loss"),
}

COMPARED: Mapping[str, Callable[[Image, Image], float]] = {
    name: measure.compare for name, measure in MEASURES.items() if measure.compare is not None
}
"""The functions of the measures that compare two pictures."""
