"""The protocol ``stanford-orb``: Stanford-ORB's own evaluation (Kuang et al. 2023), from the released evaluator.

Images are linear, and the mask is eroded. Everything outside the eroded mask is set to zero on both sides and still
counts in every mean over pixels.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import max_pool2d

from radiogs_core.scene.colour import srgb_decode, srgb_encode

from .albedo import least_squares
from .conventions import Albedo, Depth, Lpips, Normal, Ssim, Task
from .measures import COMPARED
from .pictures import Image, Mask
from .protocol import EMPTY, Protocol, Scores, compared, coverages, inside, perceptual
from .psnr import decibel, mse
from .ssim import ssim
from .values import Value

Rgb = Float[Tensor, "height width 3"]

Region = Bool[Tensor, "height width"]

EROSION = 5
"""Side of the box that erodes the mask, pixels."""

BRIGHTEST = 4.0
"""PSNR-H clips at this value, although its peak is 1."""

GREY = 0.5
"""The PSNR of this constant inside the mask is a lower bound of every PSNR."""

NOTHING = 1e-6
"""A prediction whose sum of squares inside the mask is at most this in a channel counts as missing."""

NORMAL_GUARD = 1e-6
"""Added to the length of a normal before it is divided by; a missing one is then at distance 1 from any other."""

ORB_SSIM = Ssim(window=3, padding="reflect")
"""kornia's, with the window that the evaluator asks for."""


NOT_ITS_OWN = ("nvs", "relight", "psnr")

NO_SINGLE_PSNR = Value(None, "Stanford-ORB has two PSNRs instead: psnr_h and psnr_l")

NO_ANGLE = Value(None, "Stanford-ORB has the cosine distance instead: cosine")


@dataclass(frozen=True)
class StanfordOrb(Protocol):
    """Scores inside the eroded mask; relit images and albedo are aligned per image and channel, new views not at all.

    Images come as display sRGB in [0, 1]; ``score_linear`` takes linear ones, whose highlights PSNR-H counts up to 4.
    """

    def describe(self) -> dict[str, Any]:
        """Every convention in words, without backgrounds, which this evaluator does not have."""
        inherited = {name: words for name, words in super().describe().items() if name not in NOT_ITS_OWN}
        return inherited | {
            "region": f"mask eroded by {EROSION} x {EROSION}; zero outside, which counts in every mean",
            "psnr_h": f"linear, at display brightness, clipped at {BRIGHTEST:g}, peak 1",
            "psnr_l": "display sRGB, peak 1; neither is below that of a grey of 0.5",
            "lpips_images": "display sRGB encoded a second time; albedo once",
            "relight_scale": "least squares a channel and view",
        }

    def score_image(
        self, image: Image, target: Image, mask: Mask | None = None, alpha: Mask | None = None, task: Task = "nvs"
    ) -> Scores:
        """``psnr_h``, ``psnr_l``, ``ssim`` and ``lpips`` of one display image."""
        return self.score_linear(srgb_decode(image), srgb_decode(target), mask, task)

    def score_linear(self, image: Image, target: Image, mask: Mask | None = None, task: Task = "nvs") -> Scores:
        """The measures of ``score_image`` of a linear image; LPIPS encodes it to sRGB twice, as the evaluator does."""
        mask, _ = coverages(target, mask, None)
        region = eroded(mask)
        if task == "indirect" or not region.any():
            reason = EMPTY if task != "indirect" else f"protocol '{self.name}' does not compare indirect light"
            return self.no_comparison(reason)
        target = target.clamp(min=0)
        if task == "relight":
            image = aligned(image, target, region)
        ours, theirs = displayed(image, region), displayed(target, region)
        return {
            "psnr": NO_SINGLE_PSNR,
            "psnr_h": Value(psnr_h(image, target, region)),
            "psnr_l": Value(psnr_l(image, target, region)),
            "ssim": Value(ssim(ours, theirs, self.ssim)),
            "lpips": perceptual(srgb_encode(ours), srgb_encode(theirs), self.lpips[0]),
            **compared(ours, theirs),
        }

    def no_comparison(self, reason: str) -> Scores:
        """The measures of ``score_image``, all n/a with the given reason."""
        return {measure: Value(None, reason) for measure in ("psnr", "psnr_h", "psnr_l", "ssim", "lpips", *COMPARED)}

    def albedo_scale(
        self,
        predictions: Sequence[Image],
        truths: Sequence[Image],
        masks: Sequence[Mask],
        alphas: Sequence[Mask] | None = None,
    ) -> Float[Tensor, "3"]:
        """Ones: each view is aligned separately."""
        return torch.ones(3)

    def score_albedo(
        self,
        prediction: Image,
        target: Image,
        scale: Float[Tensor, "3"],
        mask: Mask | None = None,
        alpha: Mask | None = None,
    ) -> Scores:
        """``psnr`` and ``ssim`` of linear albedo, ``lpips`` of it in display sRGB, after least squares per channel."""
        mask, _ = coverages(target, mask, None)
        region = eroded(mask)
        if not region.any():
            return {measure: Value(None, EMPTY) for measure in ("psnr", "ssim", "lpips", *COMPARED)}
        prediction = aligned(prediction, target, region)
        ours, theirs = (masked(side, region).clamp(0, 1) for side in (prediction, target))
        return {
            "psnr": Value(_floored(ours, theirs, region)),
            "ssim": Value(ssim(ours, theirs, self.ssim)),
            "lpips": perceptual(srgb_encode(ours), srgb_encode(theirs), self.lpips[0]),
            **compared(ours, theirs),
        }

    def score_normal(self, normal: Image, target: Image, mask: Mask, alpha: Mask | None = None) -> Scores:
        """``cosine``: mean of 1 - cos in the eroded mask."""
        return {"mae": NO_ANGLE, "cosine": inside(normal_cosine(normal, target, eroded(mask)))}

    def score_depth(self, depths: Sequence[Image], targets: Sequence[Image], masks: Sequence[Mask]) -> list[Scores]:
        """``simse`` in the eroded masks; a view without depth (sum z^2 <= 1e-6 there) counts as a depth of one."""
        regions = [eroded(mask)[..., None] for mask in masks]
        given = [
            torch.ones_like(depth) if float(depth[region].double().square().sum()) <= NOTHING else depth
            for depth, region in zip(depths, regions, strict=True)
        ]
        return super().score_depth(given, targets, [region.float() for region in regions])


STANFORD_ORB = StanfordOrb(
    "stanford-orb",
    version=2,
    ssim=ORB_SSIM,
    lpips=(Lpips("vgg"),),
    normal=Normal(measure="cosine", region="eroded mask"),
    albedo=replace(Albedo(), align="least squares", fitted_to="each view", pixels="eroded mask", relights=False),
    roughness=None,
    indirect=None,
    depth=Depth(),
)


def eroded(mask: Float[Tensor, "height width 1"]) -> Region:
    """Pixels whose 5 x 5 neighbours are all covered by more than half; outside the frame counts as covered."""
    outside = (mask[..., 0] <= 0.5).float()[None, None]
    return max_pool2d(outside, EROSION, stride=1, padding=EROSION // 2)[0, 0] == 0


def masked(image: Rgb, region: Region) -> Rgb:
    """The image, exactly zero outside the mask, even where it is NaN."""
    return torch.where(region[..., None], image, 0.0)


def aligned(image: Rgb, target: Rgb, region: Region) -> Rgb:
    """The image times the least-squares factor of each channel inside the mask: sum(x y) / sum(x^2).

    If sum(x^2) <= 1e-6 the factor is sum(y) / n, as for an image of ones, and an almost black image stays black.
    """
    ours = image[region]
    nothing = ours.double().square().sum(0) <= NOTHING
    return image * least_squares(torch.where(nothing, 1.0, ours), target[region])


def psnr_h(image: Rgb, target: Rgb, region: Region) -> float:
    """PSNR-H in dB: both sides times the gain that brings the truth to display brightness, clipped at 4.

    The gain is mean(sRGB(truth)) / mean(truth) of the truth clipped to [0, 1]; 1 for a black truth.
    """
    ours, theirs = masked(image, region), masked(target, region).clamp(min=0)
    shown = theirs.clamp(0, 1).double()
    brightness = float(shown.mean())
    gain = float(srgb_encode(shown).mean()) / brightness if brightness > 0 else 1.0
    return _floored((gain * ours).clamp(0, BRIGHTEST), (gain * theirs).clamp(0, BRIGHTEST), region)


def psnr_l(image: Rgb, target: Rgb, region: Region) -> float:
    """PSNR-L in dB: PSNR of display images."""
    return _floored(displayed(image, region), displayed(target, region), region)


def displayed(image: Rgb, region: Region) -> Rgb:
    """Display sRGB of the clipped linear image, zero outside the mask."""
    return srgb_encode(masked(image, region).clamp(0, 1))


def normal_cosine(normal: Rgb, target: Rgb, region: Region) -> float:
    """Mean of 1 - cos over the mask; NaN if it is empty."""
    ours, theirs = (side[region].double() for side in (normal, target))
    ours, theirs = (side / (side.norm(dim=-1, keepdim=True) + NORMAL_GUARD) for side in (ours, theirs))
    return float((1 - (ours * theirs).sum(-1)).mean())


def _floored(ours: Rgb, theirs: Rgb, region: Region) -> float:
    grey = masked(torch.full_like(theirs, GREY), region)
    return max(decibel(mse(ours, theirs)), decibel(mse(grey, theirs)))
