"""A rehearsal in lines of Markdown, as ``rehearse`` prints it."""

from collections.abc import Mapping
from itertools import zip_longest
from statistics import fmean
from typing import Any

from ...durations import duration

GIB = 2**30


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
    return [*lines, "", *models, *_forecasts(record, name), ""]


def _cell(phase: Mapping[str, Any] | None) -> str:
    """Mean seconds to two or three digits, and the peak; empty where the phase was not measured."""
    if phase is None:
        return " | "
    seconds, peaks = fmean(phase["seconds"]), phase["peaks"]
    return f"{seconds:.{0 if seconds >= 10 else 2}f} | {peaks.get('device', peaks['host']) / GIB:.2f}"


def _forecasts(record: Mapping[str, Any], name: str) -> list[str]:
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
