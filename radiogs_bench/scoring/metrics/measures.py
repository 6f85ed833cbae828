"""Every measure by name: how tables print it and, for one that compares two pictures by itself, its function."""

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
    compare: Callable[[Image, Image], float] | None = None
    """Computes it from a prediction and its truth, both [height, width, 3], as the protocol lays them out.

    Then every protocol scores it for new views, relit views, indirect light and albedo; NaN reads n/a. None for a
    measure that depends on more than two pictures: whatever computes it says so.
    """


MEASURES: Mapping[str, Measure] = {
    "psnr": Measure("PSNR", "dB", "up", 2),
    # Of a relit image, against the one of the method's own reference.
    "psnr_reference": Measure("PSNR to reference", "dB", "up", 2),
    "ssim": Measure("SSIM", "", "up", 3),
    "lpips": Measure("LPIPS", "", "down", 3),
    "mae": Measure("MAE", "deg", "down", 2),
    "mse": Measure("MSE", "", "down", 4),
    "delta_e": Measure("CIEDE2000", "", "down", 2),
    "ms": Measure("time", "ms", "down", 2),
    "megabytes": Measure("memory", "MB", "down", 1),
    "bias": Measure("bias", "%", "zero", 2),
    # Stanford-ORB's own: two PSNRs, 1 - cos of normals, scale-invariant depth, distance of surfaces.
    "psnr_h": Measure("PSNR-H", "dB", "up", 2),
    "psnr_l": Measure("PSNR-L", "dB", "up", 2),
    "cosine": Measure("cosine distance", "", "down", 4),
    "simse": Measure("SI-MSE", "sq. unit", "down", 5),
    "offset": Measure("offset", "% of extent", "down", 2),
    "chamfer": Measure("chamfer", "sq. unit", "down", 6),
    # The network beside a protocol's first one is named.
    "lpips_alex": Measure("LPIPS (AlexNet)", "", "down", 3),
    "lpips_vgg": Measure("LPIPS (VGG)", "", "down", 3),
    "lpips_squeeze": Measure("LPIPS (SqueezeNet)", "", "down", 3),
    # Of a recovered environment map, as it is and after the protocol's alignment.
    "error": Measure("error", "", "down", 3),
    "error_scaled": Measure("error up to scale", "", "down", 3),
    # Recovered light as surfaces in the test views receive it, and the error that its resolution alone costs.
    "irradiance": Measure("error of irradiance", "", "down", 3),
    "reflection": Measure("error of reflections", "", "down", 3),
    "floor": Measure("error of the truth at this resolution", "", "down", 3),
    # Of the best map that is the same everywhere: a recovered one that is no better carries no information.
    "constant": Measure("error of a constant", "", "down", 4),
    # Of float32 against float64, in units of its rounding, 1.19e-7.
    "safe": Measure("error, safe range", "eps", "down", 1),
    "hard": Measure("error, hard end", "eps", "down", 1),
    "share": Measure("share of the tolerance", "", "down", 3),
    "fired": Measure("that acted", "times", "down", 0),
    # Of leaving out effects: what is traced, and what that may cost.
    "rays": Measure("rays", "M", "down", 2),
    "seconds": Measure("duration", "s", "down", 1),
    "bound": Measure("bound on the loss", "dB", "down", 3),
    "worst": Measure("worst case", "dB", "down", 2),
}

COMPARED: Mapping[str, Callable[[Image, Image], float]] = {
    name: measure.compare for name, measure in MEASURES.items() if measure.compare is not None
}
"""The functions of those measures that have one."""
