"""A rehearsal as it is stored: what was measured, the forecast of the whole run, and what does not fit."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import torch

from ...store.provenance import session
from .climb import Rehearsal
from .growth import SizeResult, extended, peak
from .limits import KNOWN_DEVICES, speed_of
from .phases import Phase
from .plan import Plan, size_range

SCHEMA = "radiogs-bench/rehearsal/1"

Plain = dict[str, Any]


def record_of(plan: Plan, climbed: Rehearsal) -> Plain:
    """Everything as plain values."""
    camera = plan.scene.train[0].camera
    named = next((row.method.size_name for row in plan.rows if row.sizes() is not None), None)  # type: ignore[attr-defined]
    forecast = _forecasts(plan, climbed)
    content: Plain = {
        "schema": SCHEMA,
        "name": plan.name,
        "preset": plan.preset,
        "scene": {
            "name": plan.scene.name,
            "train": len(plan.scene.train),
            "test": len(plan.scene.test),
            "width": camera.width,
            "height": camera.height,
            "masks": plan.scene.train[0].has("alpha"),
            "lights": len(plan.scene.lights),
            "remarks": list(plan.scene.repairs),
        },
        "rows": [row.key for row in plan.rows],
        "cells": plan.cells,
        "size_name": named,
        "clock": plan.clock,
        "memory": dict(plan.memory),
        "session": session(plan.device),
        "rungs": [_rung(rung) for rung in climbed.rungs],
        "refusal": None if climbed.refusal is None else asdict(climbed.refusal),
        "forecast": forecast,
    }
    if plan.other_device is not None and forecast:
        content["other"] = _other(plan.other_device, plan.device, forecast, climbed.rungs[0].base)
    return content


def fits(content: Mapping[str, Any]) -> bool:
    """Whether there is memory for all that was asked for, as far as is known."""
    refused = content["refusal"] is not None and not content["refusal"]["fits"]
    return not refused and all(not each["beyond"] for each in content["forecast"])


def _rung(rung: SizeResult) -> Plain:
    """The measurements at a size as plain values; ``refusal`` tells why they ended."""
    kept = ("title", "key", "seconds", "whole", "peaks")
    phases = [{name: getattr(phase, name) for name in kept} for phase in rung.phases]
    return {
        **{name: getattr(rung, name) for name in ("size", "base", "seconds", "busy", "rows", "facts")},
        "phases": phases,
    }


def _forecasts(plan: Plan, climbed: Rehearsal) -> list[Plain]:
    """Forecasts at the size at which runs begin and at the largest, where they were measured or two others were."""
    whole = [rung for rung in climbed.rungs if rung.whole]
    found = []
    for size in dict.fromkeys(size_range(plan.rows) or (None,)):
        measured = next((rung for rung in whole if rung.size == size), None)
        if measured is not None:
            found.append(_forecast(plan, size, measured.phases, measured.rows, measured=True))
        elif size is not None and len(whole) > 1:
            found.append(_forecast(plan, size, extended(whole, size), whole[-1].rows, measured=False))
    return found


def _forecast(
    plan: Plan, size: int | None, phases: Sequence[Phase], rows: Mapping[str, Sequence[str]], *, measured: bool
) -> Plain:
    """Seconds of the whole run if its models had this size throughout, peaks, and the places where they do not fit."""
    seconds, error = whole_of(phases, rows, plan.cells)
    peaks = {where: peak(phases, where) for where in plan.memory}
    return {
        "size": size,
        "measured": measured,
        "seconds": seconds,
        "error": error,
        "peaks": {where: {"bytes": amount, "phase": title} for where, (amount, title) in peaks.items()},
        "beyond": [where for where, (amount, _) in peaks.items() if amount > plan.memory[where]],
    }


def _other(name: str, device: torch.device, forecast: Sequence[Plain], base: Mapping[str, int]) -> Plain:
    """The forecast for another device, between what arithmetic and what memory traffic alone would say.

    Seconds are multiplied by the ratio of speeds here and there, of operations for the lower end and of bytes for the
    upper one, whichever is smaller or larger. Memory is what the process took here beyond ``base``, which it had at
    first.
    """
    known, here = KNOWN_DEVICES[name], speed_of(device)
    low, high = sorted((here.operations / known.speed.operations, here.bytes / known.speed.bytes))
    at = "device" if device.type == "cuda" else "host"
    peaks = [each["peaks"][at]["bytes"] - (0 if at == "device" else base[at]) for each in forecast]
    return {
        "name": name,
        "title": known.title,
        "source": known.source,
        "speed_here": asdict(here),
        "speed_there": asdict(known.speed),
        "ratios": [low, high],
        "seconds": [forecast[0]["seconds"] * low, forecast[-1]["seconds"] * high],
        "peaks": peaks,
        "memory": known.memory,
        "fits": [amount <= known.memory for amount in peaks],
    }


def whole_of(phases: Sequence[Phase], rows: Mapping[str, Sequence[str]], cells: int) -> tuple[float, float]:
    """Seconds of a whole run with models of one size, and their standard error from the steps' measurement alone.

    All rows, each on ``cells`` scenes and seeds; stages that rows share are trained once.
    """
    trained = {key for keys in rows.values() for key in keys if " " not in key}
    shown = [key for keys in rows.values() for key in keys if " " in key]
    times = {phase.key: 0 for phase in phases} | dict.fromkeys(trained, 1)
    for key in shown:
        times[key] = times.get(key, 0) + 1
    seconds = math.fsum(times[phase.key] * phase.whole * phase.mean for phase in phases)
    squares = math.fsum((times[phase.key] * phase.whole * phase.error) ** 2 for phase in phases)
    return cells * seconds, cells * math.sqrt(squares)
