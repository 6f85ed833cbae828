"""Named metric protocols: one bundle of conventions, so that two figures under one name can be compared."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from jaxtyping import Float
from torch import Tensor

from radiogs.errors import UsageError

from . import albedo, lpips, normals, psnr, ssim, values
from .values import PSNR_CAP, Value

Image = Float[Tensor, "height width channels"]
Mask = Float[Tensor, "height width 1"]


@dataclass(frozen=True)
class Protocol:
    """Conventions ``default``: display images in [0, 1] on black, scored over the whole image, mean over views.

    PSNR over all channels jointly; SSIM without padding; LPIPS on AlexNet; normals in degrees inside the mask;
    roughness inside the mask; albedo linear on black after the per-channel median alignment.
    """

    name: str

    def describe(self) -> dict[str, Any]:
        """The conventions, spelled out for the record."""
        return {
            "name": self.name,
            "images": "display sRGB, clipped to [0, 1], not quantised, composited on black, whole image",
            "albedo": "linear, on black, scaled by the per-channel median of truth / prediction over all views",
            "psnr": f"peak 1, joint over channels, capped at {PSNR_CAP:g} dB, mean over views",
            "ssim": "Gaussian 11 taps, sigma 1.5, valid windows, population covariance, range 1",
            "lpips": "AlexNet, v0.1, inputs scaled to [-1, 1]",
            "normal": "mean angle in degrees where true coverage > 0.5, holes count 90",
            "roughness": "mean squared error where true coverage > 0.5",
        }

    def albedo_scale(
        self, predictions: Sequence[Image], truths: Sequence[Image], masks: Sequence[Mask]
    ) -> Float[Tensor, "3"]:
        """Per-channel factor for the recovered albedo; see ``albedo.albedo_scale``."""
        return albedo.albedo_scale(predictions, truths, masks)

    def score_image(self, image: Image, target: Image) -> dict[str, Value]:
        """``psnr``, ``ssim`` and ``lpips`` of one image in [0, 1]."""
        return {
            "psnr": Value(psnr.psnr(image, target)),
            "ssim": _unless_too_small(image, ssim.WINDOW, lambda: ssim.ssim(image, target)),
            "lpips": self._lpips(image, target),
        }

    def normal_mae(self, normal: Image, target: Image, mask: Mask) -> Value:
        """Mean angular error in degrees inside the mask."""
        return _inside(normals.normal_mae(normal, target, mask))

    def roughness_mse(self, roughness: Image, target: Image, mask: Mask) -> Value:
        """Mean squared error of roughness inside the mask."""
        return _inside(psnr.masked_mse(roughness, target, mask))

    def mean(self, views: Sequence[Value]) -> Value:
        """Mean over views."""
        return values.mean(views)

    def _lpips(self, image: Image, target: Image) -> Value:
        missing = lpips.missing_weights()
        if missing:
            return Value(None, missing)
        return _unless_too_small(image, lpips.SMALLEST_SIDE, lambda: lpips.lpips(image, target))


def _unless_too_small(image: Image, side: int, compute: Callable[[], float]) -> Value:
    if min(image.shape[:2]) < side:
        return Value(None, f"images are smaller than {side} pixels")
    return Value(compute())


def _inside(value: float) -> Value:
    return Value(value) if math.isfinite(value) else Value(None, "the mask is empty")


PROTOCOLS = {"default": Protocol("default")}


def protocol(name: str) -> Protocol:
    """The protocol of that name. Raises UsageError for an unknown one."""
    if name not in PROTOCOLS:
        near = get_close_matches(name, PROTOCOLS, 1)
        raise UsageError(
            f"unknown metric protocol '{name}'",
            f"Did you mean '{near[0]}'?" if near else "",
            f"Protocols: {', '.join(PROTOCOLS)}.",
        )
    return PROTOCOLS[name]
