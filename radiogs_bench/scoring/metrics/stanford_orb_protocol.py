"""The protocol ``stanford-orb``: the benchmark's evaluator behind the interface of all protocols."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.colour import srgb_decode, srgb_encode

from . import stanford_orb as orb
from .conventions import Albedo, Depth, Lpips, Normal, Task
from .pictures import Image, Mask
from .protocol import EMPTY, Protocol, Scores, coverages, inside, perceptual
from .ssim import ssim
from .values import Value

NOT_ITS_OWN = ("nvs", "relight", "psnr")

NO_SINGLE_PSNR = Value(None, "Stanford-ORB has two PSNRs instead: psnr_h and psnr_l")
NO_ANGLE = Value(None, "Stanford-ORB has the cosine distance instead: cosine")


@dataclass(frozen=True)
class StanfordOrb(Protocol):
    """Scores inside the eroded mask; relit images and albedo are aligned per image and channel, new views are not.

    Images come as display sRGB in [0, 1]; ``score_linear`` takes linear ones, whose highlights PSNR-H counts up to 4.
    """

    def describe(self) -> dict[str, Any]:
        """Every convention in words, without backgrounds, which this evaluator does not have."""
        inherited = {name: words for name, words in super().describe().items() if name not in NOT_ITS_OWN}
        return inherited | {
            "region": f"mask eroded by {orb.EROSION} x {orb.EROSION}; zero outside, which counts in every mean",
            "psnr_h": f"linear, at display brightness, clipped at {orb.BRIGHTEST:g}, peak 1",
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
        region = orb.eroded(mask)
        if task == "indirect" or not region.any():
            reason = EMPTY if task != "indirect" else f"protocol '{self.name}' does not compare indirect light"
            return self.no_comparison(reason)
        target = target.clamp(min=0)
        if task == "relight":
            image = orb.aligned(image, target, region)
        ours, theirs = orb.displayed(image, region), orb.displayed(target, region)
        return {
            "psnr": NO_SINGLE_PSNR,
            "psnr_h": Value(orb.psnr_h(image, target, region)),
            "psnr_l": Value(orb.psnr_l(image, target, region)),
            "ssim": Value(ssim(ours, theirs, self.ssim)),
            "lpips": perceptual(srgb_encode(ours), srgb_encode(theirs), self.lpips[0]),
        }

    def no_comparison(self, reason: str) -> Scores:
        """The measures of ``score_image``, all n/a with the given reason."""
        return {measure: Value(None, reason) for measure in ("psnr", "psnr_h", "psnr_l", "ssim", "lpips")}

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
        """``psnr`` and ``ssim`` of linear albedo, ``lpips`` of it as display sRGB, after least squares a channel."""
        mask, _ = coverages(target, mask, None)
        region = orb.eroded(mask)
        if not region.any():
            return {measure: Value(None, EMPTY) for measure in ("psnr", "ssim", "lpips")}
        prediction = orb.aligned(prediction, target, region)
        ours, theirs = (orb.masked(side, region).clamp(0, 1) for side in (prediction, target))
        return {
            "psnr": Value(orb.psnr_linear(prediction, target, region)),
            "ssim": Value(ssim(ours, theirs, self.ssim)),
            "lpips": perceptual(srgb_encode(ours), srgb_encode(theirs), self.lpips[0]),
        }

    def score_normal(self, normal: Image, target: Image, mask: Mask, alpha: Mask | None = None) -> Scores:
        """``cosine``: mean of 1 - cos in the eroded mask."""
        return {"mae": NO_ANGLE, "cosine": inside(orb.normal_cosine(normal, target, orb.eroded(mask)))}

    def score_depth(self, depths: Sequence[Image], targets: Sequence[Image], masks: Sequence[Mask]) -> list[Scores]:
        """``simse`` in the eroded masks."""
        return super().score_depth(depths, targets, [orb.eroded(mask)[..., None].float() for mask in masks])


STANFORD_ORB = StanfordOrb(
    "stanford-orb",
    ssim=orb.ORB_SSIM,
    lpips=(Lpips("vgg"),),
    normal=Normal(measure="cosine", region="eroded mask"),
    albedo=replace(Albedo(), align="least squares", fitted_to="each view", pixels="eroded mask", relights=False),
    roughness=None,
    indirect=None,
    depth=Depth(),
)
