"""Which metrics two protocols compute alike, so that a value by one may stand beside a value by the other."""

from typing import Any

from .measures import COMPARED
from .protocol import Protocol


def alike(one: Protocol, other: Protocol, metric: str) -> bool:
    """Whether both compute ``metric`` (``task/measure``) by the same conventions.

    Metrics that no protocol governs, such as times, are alike in all.
    """
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
