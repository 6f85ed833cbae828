"""A rehearsal as it is stored: what was measured, the forecast of the whole run, and what does not fit."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import torch

from radiogs_core.scene.scene import Scene

from ...store.provenance import session
from .climb import Bounds, Rehearsal
from .growth import SizeResult, extended, peak
from .limits import KNOWN_DEVICES, Speed, speed_of
from .phases import Phase
from .row import Row

SCHEMA = "radiogs-bench/rehearsal/1"


@dataclass(frozen=True)
class Asked:
    """The subject of a rehearsal and its settings."""

    name: str
    """The name of the suite or scene."""
    preset: str
    """Name of the preset."""
    scene: Scene
    """Scene of the rehearsal."""
    cells: int
    """The number of scenes that the whole run has for each row."""
    bounds: Bounds
    """Limits of the rehearsal."""
    device: torch.device
    """Device of the rehearsal."""
    other_device: str | None = None
    """Device that the forecast is for, if it is another one."""
    clock: str = "wall"
    """The seconds that are counted, "wall" or "core"."""


def record_of(asked: Asked, rows: Sequence[Row], climbed: Rehearsal) -> dict[str, Any]:
    """Everything as plain values."""
    camera = asked.scene.train[0].camera
    named = next((row.method.size_name for row in rows if row.sizes() is not None), None)  # type: ignore[attr-defined]
    content: dict[str, Any] = {
        "schema": SCHEMA,
        "name": asked.name,
        "preset": asked.preset,
        "scene": {
            "name": asked.scene.name,
            "train": len(asked.scene.train),
            "test": len(asked.scene.test),
            "width": camera.width,
            "height": camera.height,
            "masks": asked.scene.train[0].has("alpha"),
            "lights": len(asked.scene.lights),
            "remarks": list(asked.scene.repairs),
        },
        "rows": [row.key for row in rows],
        "cells": asked.cells,
        "size_name": named,
        "clock": asked.clock,
        "memory": dict(asked.bounds.memory),
        "session": session(asked.device),
        "rungs": [_rung(rung) for rung in climbed.rungs],
        "refusal": None if climbed.refusal is None else asdict(climbed.refusal),
        "forecast": [],
    }
    whole = [rung for rung in climbed.rungs if rung.whole]
    if whole:
        start = min((sizes[0] for row in rows if (sizes := row.sizes()) is not None), default=None)
        for size in dict.fromkeys((start, climbed.largest)):
            if len(whole) > 1 or whole[0].size == size:
                content["forecast"].append(_forecast(asked, whole, size))
        if asked.other_device is not None and content["forecast"]:
            content["other"] = _other(asked.other_device, asked.device, content["forecast"], whole)
    return content


def fits(content: Mapping[str, Any]) -> bool:
    """Whether there is memory for all that was asked for, as far as is known."""
    refused = content["refusal"] is not None and not content["refusal"]["fits"]
    return not refused and all(not each["beyond"] for each in content["forecast"])


def _rung(rung: SizeResult) -> dict[str, Any]:
    return {
        "size": rung.size,
        "base": dict(rung.base),
        "seconds": rung.seconds,
        "busy": rung.busy,
        "rows": {name: list(keys) for name, keys in rung.rows.items()},
        "facts": {name: dict(found) for name, found in rung.facts.items()},
        "phases": [phase.plain() for phase in rung.phases],
    }


def _at(rungs: Sequence[SizeResult], size: int | None) -> tuple[Sequence[Phase], bool]:
    """The phases at a size, and whether they were measured there."""
    for rung in rungs:
        if rung.size == size:
            return rung.phases, True
    assert size is not None
    return extended(rungs, size), False


def _forecast(asked: Asked, rungs: Sequence[SizeResult], size: int | None) -> dict[str, Any]:
    """Seconds of the whole run if its models had this size throughout, peaks, and the places where they do not fit."""
    phases, measured = _at(rungs, size)
    whole = whole_of(phases, rungs[-1].rows if not measured else _rows_at(rungs, size), asked.cells)
    peaks = {where: peak(phases, where) for where in asked.bounds.memory}
    return {
        "size": size,
        "measured": measured,
        "seconds": whole.seconds,
        "error": whole.error,
        "peaks": {where: {"bytes": amount, "phase": title} for where, (amount, title) in peaks.items()},
        "beyond": [where for where, (amount, _) in peaks.items() if amount > asked.bounds.memory[where]],
    }


def _rows_at(rungs: Sequence[SizeResult], size: int | None) -> Mapping[str, Sequence[str]]:
    return next(rung.rows for rung in rungs if rung.size == size)


def _other(name: str, device: torch.device, forecast: Sequence[Mapping[str, Any]], rungs: Sequence[SizeResult]) -> dict:
    """The forecast for another device, between what arithmetic and what memory traffic alone would say.

    Seconds are multiplied by the ratio of speeds here and there, of operations for the lower end and of bytes for the
    upper one, whichever is smaller or larger. Memory is what the process took here beyond what it had at first.
    """
    known, here = KNOWN_DEVICES[name], speed_of(device)
    ratios = sorted((here.operations / known.speed.operations, here.bytes / known.speed.bytes))
    at = "device" if device.type == "cuda" else "host"
    base = 0 if at == "device" else rungs[0].base["host"]
    peaks = [each["peaks"][at]["bytes"] - base for each in forecast]
    return {
        "name": name,
        "title": known.title,
        "source": known.source,
        "speed_here": asdict(here),
        "speed_there": asdict(Speed(known.speed.operations, known.speed.bytes)),
        "ratios": ratios,
        "seconds": [forecast[0]["seconds"] * ratios[0], forecast[-1]["seconds"] * ratios[1]],
        "peaks": peaks,
        "memory": known.memory,
        "fits": [amount <= known.memory for amount in peaks],
    }


@dataclass(frozen=True)
class Whole:
    """Seconds of a whole run with a model of one size. error: of the steps' measurement alone, one standard error."""

    seconds: float
    error: float


def whole_of(phases: Sequence[Phase], rows: Mapping[str, Sequence[str]], cells: int) -> Whole:
    """All rows, each on ``cells`` scenes and seeds; stages that rows share are trained once."""
    trained = {key for keys in rows.values() for key in keys if " " not in key}
    shown = [key for keys in rows.values() for key in keys if " " in key]
    times = {phase.key: 0 for phase in phases} | dict.fromkeys(trained, 1)
    for key in shown:
        times[key] = times.get(key, 0) + 1
    seconds = math.fsum(times[phase.key] * phase.whole * phase.mean for phase in phases)
    squares = math.fsum((times[phase.key] * phase.whole * phase.error) ** 2 for phase in phases)
    return Whole(cells * seconds, cells * math.sqrt(squares))
