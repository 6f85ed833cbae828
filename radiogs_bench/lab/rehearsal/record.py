"""A rehearsal as it is stored and printed: what was measured, the forecast of the whole run, and what does not fit."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import zip_longest
from statistics import fmean
from typing import Any

import torch

from ...durations import duration
from ...store.provenance import session
from .climb import Rehearsal
from .growth import SizeResult, extended, peak
from .limits import KNOWN_DEVICES, speed_of
from .phases import Phase
from .plan import Plan, size_range

SCHEMA = "radiogs-bench/rehearsal/1"

GIB = 2**30

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
    """Whether memory suffices for everything that was asked for, as far as is known."""
    refused = content["refusal"] is not None and not content["refusal"]["fits"]
    return not refused and all(not each["beyond"] for each in content["forecast"])


def _rung(rung: SizeResult) -> Plain:
    """The measurements at one size as plain values; ``refusal``: why they ended, if they did."""
    kept = ("title", "key", "seconds", "whole", "peaks")
    phases = [{name: getattr(phase, name) for name in kept} for phase in rung.phases]
    return {
        **{name: getattr(rung, name) for name in ("size", "base", "seconds", "busy", "rows", "facts")},
        "phases": phases,
    }


def _forecasts(plan: Plan, climbed: Rehearsal) -> list[Plain]:
    """Forecasts at the initial and the largest size, each if measured or extrapolated from two others."""
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
    """The forecast for another device: seconds times the ratio of both devices' speeds, and memory beyond ``base``."""
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
    """Seconds of a whole run with models of one size, and their standard error; shared stages are trained once."""
    trained = {key for keys in rows.values() for key in keys if " " not in key}
    shown = [key for keys in rows.values() for key in keys if " " in key]
    times = {phase.key: 0 for phase in phases} | dict.fromkeys(trained, 1)
    for key in shown:
        times[key] = times.get(key, 0) + 1
    seconds = math.fsum(times[phase.key] * phase.whole * phase.mean for phase in phases)
    squares = math.fsum((times[phase.key] * phase.whole * phase.error) ** 2 for phase in phases)
    return cells * seconds, cells * math.sqrt(squares)


def lines_of(record: Mapping[str, Any]) -> list[str]:
    """A rehearsal in Markdown: what was run, phases by size, forecasts, and what does not fit."""
    scene, machine = record["scene"], record["session"]["machine"]
    rungs, name = record["rungs"], record["size_name"] or "size"
    lines = [
        f"`{record['name']}`, preset {record['preset']}: {scene['train']} training and {scene['test']} test views of"
        f" {scene['width']} x {scene['height']}{'' if scene['masks'] else ', no masks'}, {scene['lights']} lights."
        f" {machine['gpu'] or machine['cpu']}, {machine['threads']} thread{'s' if machine['threads'] > 1 else ''},"
        f" {record['session']['date'][:10]}.{_shared(record)}",
        "",
    ]
    if not rungs:
        return [*lines, _refused(record, name), ""]
    sizes = [_size(rung["size"], name) for rung in rungs]
    lines += [
        "| phase | " + " | ".join(f"{size}: s | GiB" for size in sizes) + " | in the whole run |",
        "|---|" + "---:|---:|" * len(rungs) + "---:|",
    ]
    for phases in zip_longest(*(rung["phases"] for rung in rungs)):
        known = next(phase for phase in phases if phase is not None)
        lines.append(f"| {known['title']} | {' | '.join(map(_cell, phases))} | {known['whole']:,} |")
    models: list[str] = []
    for rung in rungs:
        facts = {row: found for row, found in rung["facts"].items() if found}
        if rung["size"] is not None and facts:
            said = "; ".join(
                f"{row}: {', '.join(f'{amount:,} {what}' for what, amount in found.items())}"
                for row, found in facts.items()
            )
            models.append(f"- Models at the end, begun with {_size(rung['size'], name)}: {said}.")
    return [*lines, "", *models, *_forecasts_said(record, name), ""]


def _cell(phase: Mapping[str, Any] | None) -> str:
    """Mean seconds to two or three digits, and the peak; empty where the phase was not measured."""
    if phase is None:
        return " | "
    seconds, peaks = fmean(phase["seconds"]), phase["peaks"]
    return f"{seconds:.{0 if seconds >= 10 else 2}f} | {peaks.get('device', peaks['host']) / GIB:.2f}"


def _forecasts_said(record: Mapping[str, Any], name: str) -> list[str]:
    lines = []
    for each in record["forecast"]:
        peaks = ", ".join(
            f"{peak['bytes'] / GIB:.1f} GiB of the {where}'s {record['memory'][where] / GIB:.1f} ({peak['phase']})"
            for where, peak in each["peaks"].items()
        )
        how = "measured" if each["measured"] else "extended"
        verdict = "does not fit" if each["beyond"] else "fits"
        lines.append(
            f"- Forecast at {_size(each['size'], name)} throughout ({how}): {duration(each['seconds'])}"
            f" ± {duration(each['error'])}; {peaks}: {verdict}."
        )
    if "other" in record:
        other = record["other"]
        low, high = other["seconds"]
        memory = " to ".join(f"{amount / GIB:.1f}" for amount in dict.fromkeys(other["peaks"]))
        verdict = "fits" if all(other["fits"]) else "the largest does not fit"
        lines.append(
            f"- Forecast, not measured, for an {other['title']}: {duration(low)} to {duration(high)};"
            f" {memory} GiB of {other['memory'] / GIB:.0f}: {verdict}."
        )
    if record["refusal"] is not None:
        lines.append(f"- {_refused(record, name)}")
    return lines


def _refused(record: Mapping[str, Any], name: str) -> str:
    refusal = record["refusal"]
    return f"Not rehearsed at {_size(refusal['size'], name)}: {refusal['why']}."


def _size(size: int | None, name: str) -> str:
    return "its own sizes" if size is None else f"{size:,} {name}"


def _shared(record: Mapping[str, Any]) -> str:
    shares = " and ".join(f"{100 * rung['busy']:.0f} %" for rung in record["rungs"])
    if not shares:
        return ""
    counted = "Seconds are those with a core." if record["clock"] == "core" else "Seconds are those that passed."
    return f" The process had a core {shares} of the time. {counted}"
