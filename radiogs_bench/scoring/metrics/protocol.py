"""A metric protocol: one bundle of conventions, so that two values under one name are comparable."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from .albedo import PER_CHANNEL_MEDIAN, albedo_scale, ciede2000, encoded
from .conventions import (
    Albedo,
    Depth,
    DepthOffset,
    Environment,
    Indirect,
    Lpips,
    Normal,
    Picture,
    Psnr,
    Roughness,
    Ssim,
    Task,
)
from .environment import environment_error
from .geometry import IN_MASK, depth_errors, depth_offset, normal_mae
from .lpips import ALEX, SMALLEST_SIDE, lpips
from .measures import COMPARED
from .pictures import AS_RENDERED, Image, Mask, needs_truth, predicted, times, true
from .psnr import JOINT, decibel, error_of, masked_mse, mse, psnr
from .ssim import WANG, smallest_side, ssim
from .values import PSNR_CAP, Value, mean
from .weights import missing_weights

Scores = dict[str, Value]
"""Values by measure: ``psnr``, ``ssim``, ``lpips``, ``mae``, ``mse``, ``error``."""

EMPTY = "the mask is empty"

SOLID_ROUGHNESS, OUTGOING, FACTOR_A_CHANNEL = Roughness(), Indirect(), Environment()
"""Roughness inside the mask; radiance towards the camera; light aligned by a factor per channel."""


@dataclass(frozen=True)
class Protocol:
    """Conventions, one per field; the defaults are those of protocol ``default``.

    All maps are given on black. ``mask`` is the true and ``alpha`` the predicted coverage, [height, width, 1]: without
    a mask the truth covers everything; without an alpha the prediction's coverage is the true one. None as a field
    means that the protocol does not compare this map: "n/a".
    """

    name: str
    version: int = 1
    """Raised when values under this name change (docs/protocols.md, "Versions")."""
    nvs: Picture = AS_RENDERED
    relight: Picture = AS_RENDERED
    psnr: Psnr = JOINT
    ssim: Ssim = WANG
    lpips: tuple[Lpips, ...] = (ALEX,)
    normal: Normal | None = IN_MASK
    albedo: Albedo = PER_CHANNEL_MEDIAN
    roughness: Roughness | None = SOLID_ROUGHNESS
    indirect: Indirect | None = OUTGOING
    depth: Depth | None = None
    depth_offset: DepthOffset | None = None
    environment: Environment = FACTOR_A_CHANNEL
    layouts: Mapping[str, Albedo] = field(default_factory=dict, hash=False)
    """Rules of albedo by layout, for layouts that the published code evaluates with a separate script."""

    @property
    def title(self) -> str:
        """Name and version, as tables show it: ``r3dg@2``; the name alone for the first version."""
        return self.name if self.version == 1 else f"{self.name}@{self.version}"

    def on(self, layout: str) -> "Protocol":
        """The protocol with its rules for scenes of a layout."""
        return replace(self, albedo=self.layouts.get(layout, self.albedo), layouts={})

    def describe(self) -> dict[str, Any]:
        """Every convention in words, as stored in results."""
        words = {name: value for name, value in asdict(self).items() if name != "layouts"}
        return words | {
            "title": self.title,
            "lpips": [asdict(rules) for rules in self.lpips],
            "images": "display sRGB, peak 1",
            "psnr_cap": f"{PSNR_CAP:g} dB",
            "mean": "over lights, then over views",
        }

    def score_image(
        self, image: Image, target: Image, mask: Mask | None = None, alpha: Mask | None = None, task: Task = "nvs"
    ) -> Scores:
        """``psnr``, ``ssim`` and ``lpips`` of one display image in [0, 1]; a second network is named (``lpips_alex``).

        For task "indirect", ``indirect.quantity`` says which indirect light both images have to show.
        """
        if task == "indirect" and self.indirect is None:
            return self.no_comparison(self._not_compared("indirect light").reason)
        rules = self._picture(task)
        mask, alpha = coverages(target, mask, alpha)
        ours, theirs = predicted(image, alpha, mask, rules), true(target, mask, rules)
        return self.compare(ours, theirs) if usable(mask, rules) else self.no_comparison(EMPTY)

    def albedo_scale(
        self,
        predictions: Sequence[Image],
        truths: Sequence[Image],
        masks: Sequence[Mask],
        alphas: Sequence[Mask] | None = None,
    ) -> Float[Tensor, "3"]:
        """Factor per channel for the recovered albedo (linear), from all views; ones without alignment."""
        rules = replace(self.albedo.picture, prediction="rendered", target=self.albedo.fitted_target, clipped=False)
        ours = [predicted(*view, rules) for view in zip(predictions, alphas or masks, masks, strict=True)]
        theirs = [true(*view, rules) for view in zip(truths, masks, strict=True)]
        return albedo_scale(ours, theirs, masks, self.albedo)

    def relighting_scale(self, scale: Float[Tensor, "3"]) -> Float[Tensor, "3"]:
        """Factor per channel for the recovered albedo in relighting: as aligned, or ones."""
        return scale if self.albedo.relights else torch.ones(3)

    def score_albedo(
        self,
        prediction: Image,
        target: Image,
        scale: Float[Tensor, "3"],
        mask: Mask | None = None,
        alpha: Mask | None = None,
    ) -> Scores:
        """``psnr``, ``ssim``, ``lpips`` of linear albedo times ``scale``, and ``delta_e`` if the rules ask for it."""
        rules = self.albedo.picture
        mask, alpha = coverages(target, mask, alpha)
        if not usable(mask, rules):
            return self.no_comparison(EMPTY) | self._difference(None)
        factor = torch.where(mask > 0, scale, 1.0) if self.albedo.scaled == "covered" else scale
        pair = predicted(prediction, alpha, mask, rules, factor), true(target, mask, rules)
        error, structure = (
            [encoded(side, space) for side in pair] for space in (self.albedo.psnr_space, self.albedo.structure_space)
        )
        scores = {"psnr": Value(psnr(error[0], error[1], self.psnr))} | self._structure(structure[0], structure[1])
        return scores | self._difference((*pair, mask))

    def score_normal(self, normal: Image, target: Image, mask: Mask, alpha: Mask | None = None) -> Scores:
        """``mae``: mean angular error in degrees of directions in one frame."""
        if self.normal is None:
            return {"mae": self._not_compared("normals")}
        return {"mae": inside(normal_mae(normal, target, mask, alpha, self.normal))}

    def score_roughness(self, roughness: Image, target: Image, mask: Mask) -> Scores:
        """``mse`` of perceptual roughness, given on black.

        Over the image: mean((a r - a^n r*)^2) with the true coverage a, the straight truth r* and n = 1, or 2 where the
        coverage is applied again (IRGS, RadioGS).
        """
        if self.roughness is None:
            return {"mse": self._not_compared("roughness")}
        if self.roughness.region == "mask" or not (mask > 0).any():
            return {"mse": inside(masked_mse(roughness, target, mask))}
        theirs = times(target, mask) if self.roughness.target == "times coverage again" else target
        return {"mse": Value(mse(times(roughness, mask), theirs))}

    def score_depth(self, depths: Sequence[Image], targets: Sequence[Image], masks: Sequence[Mask]) -> list[Scores]:
        """``simse`` of every view's z-depth; one scale may serve all views, so they come together."""
        if self.depth is None:
            return [{"simse": self._not_compared("depth")} for _ in depths]
        return [{"simse": inside(error)} for error in depth_errors(depths, targets, masks, self.depth)]

    def score_depth_offset(self, depth: Image, target: Image, mask: Mask, extent: float) -> Scores:
        """``offset`` of one view's z-depth, in percent of the scene's ``extent``."""
        if self.depth_offset is None:
            return {"offset": self._not_compared("depth")}
        return {"offset": inside(depth_offset(depth, target, mask, extent, self.depth_offset))}

    def score_environment(
        self, estimate: Float[Tensor, "height width 3"], truth: Float[Tensor, "rows columns 3"]
    ) -> Scores:
        """``error`` of the recovered light as it is, and ``error_scaled`` after the protocol's alignment."""
        black = "the true light is black"
        return {
            "error": inside(environment_error(estimate, truth), black),
            "error_scaled": inside(environment_error(estimate, truth, self.environment), black),
        }

    def mean(self, views: Sequence[Value], metric: str = "") -> Value:
        """Mean over views of a metric (``task/measure``), or its value pooled over all views.

        A pooled PSNR is the PSNR of the mean error, which equals the pooled error for views of the same size.
        """
        if metric != "albedo/psnr" or self.psnr.albedo_views == "mean":
            return mean(views)
        errors = [value if value.value is None else Value(error_of(value.value)) for value in views]
        pooled = mean(errors)
        return pooled if pooled.value is None else Value(decibel(pooled.value))

    def compare(self, ours: Image, theirs: Image) -> Scores:
        """All measures of two prepared images (see ``pictures``)."""
        return {"psnr": Value(psnr(ours, theirs, self.psnr))} | self._structure(ours, theirs)

    def no_comparison(self, reason: str) -> Scores:
        """The measures of ``compare``, all n/a with the given reason."""
        return {measure: Value(None, reason) for measure in ("psnr", "ssim", *self._perceptual(), *COMPARED)}

    def _picture(self, task: Task) -> Picture:
        if task == "indirect" and self.indirect is not None:
            return self.indirect.picture
        return self.nvs if task == "nvs" else self.relight

    def _structure(self, ours: Image, theirs: Image) -> Scores:
        found = {"ssim": large_enough(ours, smallest_side(self.ssim), lambda: ssim(ours, theirs, self.ssim))}
        found |= {name: perceptual(ours, theirs, rules) for name, rules in self._perceptual().items()}
        return found | compared(ours, theirs)

    def _difference(self, compared: tuple[Image, Image, Mask] | None) -> Scores:
        """``delta_e`` if the rules ask for it; n/a where nothing is covered."""
        if self.albedo.difference == "none":
            return {}
        return {"delta_e": Value(None, EMPTY) if compared is None else inside(ciede2000(*compared))}

    def _perceptual(self) -> dict[str, Lpips]:
        names = ["lpips", *(f"lpips_{rules.net}" for rules in self.lpips[1:])]
        return dict(zip(names, self.lpips, strict=True))

    def _not_compared(self, what: str) -> Value:
        return Value(None, f"protocol '{self.name}' does not compare {what}")


def compared(ours: Image, theirs: Image) -> Scores:
    """The measures that need nothing but two prepared images."""
    return {name: inside(compare(ours, theirs)) for name, compare in COMPARED.items()}


def perceptual(ours: Image, theirs: Image, rules: Lpips) -> Value:
    """LPIPS, or the reason why it is missing."""
    missing = missing_weights(rules.net)
    if missing:
        return Value(None, missing)
    return large_enough(ours, SMALLEST_SIDE[rules.net], lambda: lpips(ours, theirs, rules))


def large_enough(image: Image, side: int, compute: Callable[[], float]) -> Value:
    """The value, or n/a for an image that is too small for it."""
    if min(image.shape[:2]) < side:
        return Value(None, f"images are smaller than {side} pixels")
    return Value(compute())


def inside(value: float, reason: str = EMPTY) -> Value:
    """The value, or n/a if it is NaN because there was nothing to average."""
    return Value(value) if math.isfinite(value) else Value(None, reason)


def usable(mask: Mask, rules: Picture) -> bool:
    """Whether the true coverage leaves any pixel to compare; without one, the comparison would be perfect."""
    return not needs_truth(rules) or bool((mask > 0).any())


def coverages(target: Image, mask: Mask | None, alpha: Mask | None) -> tuple[Mask, Mask]:
    """True and predicted coverage, with defaults if not given."""
    if mask is None:
        mask = torch.ones(*target.shape[:2], 1)
    return mask, mask if alpha is None else alpha


def alike(one: Protocol, other: Protocol, metric: str) -> bool:
    """Whether both compute ``task/measure`` by the same conventions; true for metrics without conventions."""
    return conventions(one, metric) == conventions(other, metric)


def conventions(rules: Protocol, metric: str) -> tuple[Any, ...]:
    """Every convention that a metric's value depends on; empty for times, memory and counts."""
    task, measure, *_ = metric.split("/")
    measured_by = {"psnr": rules.psnr, "ssim": rules.ssim, "lpips": rules.lpips[0], "change": rules.psnr}
    if measure in measured_by or measure in COMPARED:
        shown = {"nvs": rules.nvs, "relight": (rules.relight, rules.albedo), "indirect": rules.indirect}
        return shown.get(task, rules.albedo), measured_by.get(measure)
    return {
        "normal": (rules.normal,),
        "roughness": (rules.roughness,),
        "depth": (rules.depth, rules.depth_offset),
        "environment": (rules.environment,),
    }.get(task, ())
