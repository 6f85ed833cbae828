"""Remarks below the tables: which values are doubtful, and how methods differ from the published ones.

Whether images determine a quantity is measured by ``scoring.what_images_determine``; methods state their differences as
labels among a model's facts.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from radiogs_reports.statistics import Estimate, estimate
from radiogs_reports.summary import Doubt

from ..runs.sweep import CellRef, Sweep
from ..scoring.metrics.protocols import PROTOCOLS
from ..scoring.what_images_determine import STEPS, shown_by_images
from ..store.schema import Determined, Result, known_values

Finished = Sequence[tuple[CellRef, Result]]
"""Finished cells with their results."""

CHANGES: Mapping[str, str] = {
    "roughness": f"changing the roughness of everything by {STEPS['roughness']:g}",
    "roughness variation": "giving everything the mean roughness",
    "brightness": f"albedo {math.exp(STEPS['brightness']):g} times as bright in a light as much darker",
    "brightness, albedo free": f"a light {math.exp(STEPS['brightness, albedo free']):g} times darker, with the albedo"
    " at each point that hides it best,",
}
"""The quantities that ``scoring.what_images_determine`` varies, in words."""

BRIGHTNESS = ("brightness", "brightness, albedo free")

CONSTANTS = {"roughness/mse": "roughness", "environment/error_scaled": "light"}
"""Metrics beside which ``task/constant`` is measured, and the quantity that is constant there."""

LIGHT = "environment/error_scaled"

NEAR_FLOOR = 0.1, 0.05
"""An error is hardly worse than ``environment/floor`` if it exceeds it by less than this share, and this much more."""

FEWEST_SEEDS = 3
"""With fewer seeds, spread is not judged: the interval from two values is five times as wide as from three."""

IN_NO_COLUMN = "No column depends on it: the protocol compares albedo and light up to a factor."


def doubts(cells: Sequence[tuple[CellRef, Result | None]], sweep: Sweep) -> list[Doubt]:
    """All doubts about a sweep's columns, in their order; last, remarks on the whole table."""
    finished = [(ref, result) for ref, result in cells if result is not None]
    if not finished:
        return []
    conventions = finished[0][1]["protocol"]
    found = earlier_version(finished[0][1])
    for column in sweep["columns"]:
        quantities = depends_on(column, conventions)
        found += over_fewer(finished, column, sweep)
        found += undetermined(finished, column, quantities)
        found += elsewhere(finished, column, quantities)
        found += no_better_than_constant(finished, column)
        found += spread_over_seeds(finished, column, quantities)
    if LIGHT in sweep["columns"]:
        found += resolution_of_light(finished, {row["key"]: row["text"] for row in sweep["rows"]})
    if not any("brightness" in depends_on(column, conventions) for column in sweep["columns"]):
        for doubt in (*undetermined(finished, "", BRIGHTNESS), *elsewhere(finished, "", BRIGHTNESS)):
            found.append(Doubt(column="", rows=doubt["rows"], text=f"{doubt['text']} {IN_NO_COLUMN}"))
    not_new = [(scene, said) for scene, lines in sweep.get("not_new", {}).items() for said in lines]
    found += [Doubt(column="", rows=[], text=f"{name}: {said}.") for name, said in not_new if name in sweep["scenes"]]
    return found


def over_fewer(finished: Finished, column: str, sweep: Sweep) -> list[Doubt]:
    """A doubt for each row that was scored from files of only some of the run's scenes or seeds."""
    every = [(scene, seed) for scene in sweep["scenes"] for seed in sweep["seeds"]]
    found = []
    for row in (line for line in sweep["rows"] if "files" in line):
        own = [(ref, result) for ref, result in finished if ref["row"] == row["key"]]
        there = [(ref["scene"], ref["seed"]) for ref, result in own if column in known_values(result["metrics"])]
        if there and len(there) < len(every):
            cells = ", ".join(scene if len(sweep["seeds"]) == 1 else f"{scene} seed {seed}" for scene, seed in there)
            text = f"{row['text']}: over {cells} alone, {len(there)} of {len(every)} scenes and seeds."
            found.append(Doubt(column=column, rows=[row["key"]], text=text))
    return found


def title_of(result: Result) -> str:
    """Name and version of the protocol of a result; results from before there were versions are of the first."""
    return str(result["protocol"].get("title", result["protocol"]["name"]))


def earlier_version(result: Result) -> list[Doubt]:
    """A remark if values are by another version of a protocol than this program computes."""
    title, name = title_of(result), result["protocol"]["name"]
    now = PROTOCOLS[name].title if name in PROTOCOLS else title
    if title == now:
        return []
    first = title if "@" in title else f"{title}@1"
    text = f"Values are by {first}; this program computes {now} (docs/protocols.md, Versions)."
    return [Doubt(column="", rows=[], text=text)]


def depends_on(column: str, conventions: Mapping[str, Any]) -> tuple[str, ...]:
    """The quantities that a metric depends on under the conventions of a protocol (``Protocol.describe``)."""
    task, _, measure = column.partition("/")
    albedo = conventions.get("albedo", {})
    if column == "roughness/mse":
        return ("roughness", "roughness variation")
    unaligned = {
        "albedo": albedo.get("align") == "none",
        "relight": albedo.get("relights") is False,
        "environment": measure == "error",
    }
    return BRIGHTNESS if unaligned.get(task, False) else ()


def undetermined(finished: Finished, column: str, quantities: Sequence[str]) -> list[Doubt]:
    """One doubt for the rows with a cell whose images do not determine one of the quantities; else none."""
    return _doubt(finished, column, quantities, lambda record: not shown_by_images(record), _not_determined)


def elsewhere(finished: Finished, column: str, quantities: Sequence[str]) -> list[Doubt]:
    """One doubt for the rows with a cell whose images determine a quantity, but not the recovered value; else none."""
    return _doubt(
        finished, column, quantities, lambda record: shown_by_images(record) and not record["determined"], _elsewhere
    )


def _doubt(
    finished: Finished,
    column: str,
    quantities: Sequence[str],
    applies: Callable[[Determined], bool],
    sentence: Callable[[str, Sequence[Determined], int], str],
) -> list[Doubt]:
    """One doubt with a sentence for each quantity that has cells to which it applies; none without such cells."""
    rows: list[str] = []
    sentences = []
    for quantity in quantities:
        measured = [(ref["row"], result["determined"][quantity]) for ref, result in finished
                    if quantity in result.get("determined", {})]  # fmt: skip
        concerned = [(row, record) for row, record in measured if applies(record)]
        if concerned:
            rows += [row for row, _ in concerned]
            of = len([row for row, _ in measured if row in rows])
            sentences.append(sentence(quantity, [record for _, record in concerned], of))
    return [Doubt(column=column, rows=list(dict.fromkeys(rows)), text=" ".join(sentences))] if rows else []


def no_better_than_constant(finished: Finished, column: str) -> list[Doubt]:
    """A doubt for the rows whose mean error is at least the error of the best constant map."""
    if column not in CONSTANTS:
        return []
    rows, references = [], []
    for row, pairs in _pairs(finished, column, f"{column.partition('/')[0]}/constant").items():
        if pairs and math.fsum(own - constant for own, constant in pairs) >= 0:
            rows.append(row)
            references.append(math.fsum(constant for _, constant in pairs) / len(pairs))
    if not rows:
        return []
    text = (
        f"no better than a {CONSTANTS[column]} that is the same everywhere: the best one has an error of"
        f" {_range(references, 4)}. The recovered one carries no information."
    )
    return [Doubt(column=column, rows=rows, text=text)]


def resolution_of_light(finished: Finished, texts: Mapping[str, str]) -> list[Doubt]:
    """A remark on the part of the recovered light's error that resolution causes, and the rows hardly worse."""
    floors, near = [], []
    for row, pairs in _pairs(finished, LIGHT, "environment/floor").items():
        floors += [(row, floor) for _, floor in pairs]
        share, more = NEAR_FLOOR
        if pairs and math.fsum(own - (1 + share) * floor - more for own, floor in pairs) <= 0:
            near.append(row)
    if not floors:
        return []
    text = (
        "recovered light: averaged to the resolution of the recovered map, the true light has an error up to scale of"
        f" {_range([floor for _, floor in floors], 3)}."
    )
    if near:
        text += f" Hardly worse than that: {', '.join(texts[row] for row in near)}."
    return [Doubt(column="", rows=list(dict.fromkeys(row for row, _ in floors)), text=text)]


def spread_over_seeds(finished: Finished, column: str, quantities: Sequence[str]) -> list[Doubt]:
    """A doubt for the rows whose seeds differ on a scene: the recovered value's t interval is wider than a step."""
    rows, sentences = [], []
    for row, results in _by_row(finished).items():
        for scene in dict.fromkeys(result["scene"] for result in results):
            for quantity in quantities:
                values = [each for result in results if result["scene"] == scene
                          if (each := recovered(result, quantity)) is not None]  # fmt: skip
                found = estimate(values) if len(values) >= FEWEST_SEEDS else None
                if found is not None and found.half_width is not None and found.half_width > STEPS[quantity]:
                    rows.append(row)
                    sentences.append(_apart(quantity, scene, found))
    text = f"seeds differ: {'; '.join(sentences)}."
    return [Doubt(column=column, rows=list(dict.fromkeys(rows)), text=text)] if rows else []


def recovered(result: Result, quantity: str) -> float | None:
    """A cell's recovered value: mean roughness, or the logarithm of the factor from its albedo to the true one."""
    if quantity == "roughness":
        return result.get("recovered", {}).get("roughness")
    scale = result["albedo_scale"] if quantity == "brightness" else None
    return math.log(math.fsum(scale) / len(scale)) if scale and math.fsum(scale) > 0 else None


def _by_row(finished: Finished) -> dict[str, list[Result]]:
    rows: dict[str, list[Result]] = {}
    for ref, result in finished:
        rows.setdefault(ref["row"], []).append(result)
    return rows


def _pairs(finished: Finished, column: str, reference: str) -> dict[str, list[tuple[float, float]]]:
    """Pairs of values by row, one pair per cell that has both metrics."""
    found: dict[str, list[tuple[float, float]]] = {}
    for ref, result in finished:
        values, pairs = known_values(result["metrics"]), found.setdefault(ref["row"], [])
        if column in values and reference in values:
            pairs.append((values[column], values[reference]))
    return found


def _not_determined(quantity: str, records: Sequence[Determined], of: int) -> str:
    changed = _range([record.get("decibels_free", record["decibels"]) for record in records], 3)
    free = {"rise_free" in record for record in records}
    rest = " or ".join(("held as recovered", "free to compensate it")[each] for each in sorted(free))
    return (
        f"{quantity}: {CHANGES[quantity]} changes the error of the training images by {changed} dB with everything else"
        f" {rest}; that is less than 8 bits resolve. The images do not determine it{_where(records, of)}."
    )


def _elsewhere(quantity: str, records: Sequence[Determined], of: int) -> str:
    return (
        f"{quantity}: a step is {CHANGES[quantity].removesuffix(',')}. With everything else as it was recovered,"
        f" {' or '.join(_reasons(records))}{_where(records, of)}; errors of shape, light or other materials can be why."
    )


def _where(records: Sequence[Determined], of: int) -> str:
    return "" if len(records) == of else f" in {len(records)} of {of} cells"


def _reasons(records: Sequence[Determined]) -> list[str]:
    """Why the recovered value is in doubt, each reason once, with the largest deviation; in steps of the quantity."""
    found = [(record["offset"], record["half_width"], record["step"]) for record in records]
    known = [(abs(offset) / step, width / step) for offset, width, step in found
             if offset is not None and width is not None]  # fmt: skip
    away = [offset for offset, _ in known if offset > 1]
    open_by = [offset + width for offset, width in known if offset <= 1]
    reasons = []
    if away:
        reasons.append(f"the views put it elsewhere, by up to {max(away):.1f} steps")
    if open_by:
        reasons.append(f"the views do not agree, by up to {max(open_by):.1f} steps")
    if len(known) < len(found):
        reasons.append("no value suits all views")
    return reasons


def _apart(quantity: str, scene: str, found: Estimate) -> str:
    assert found.half_width is not None
    if quantity == "roughness":
        return f"on {scene} {found.units} find a mean roughness of {found.mean:.2f} ± {found.half_width:.2f}"
    return f"on {scene} {found.units} find an albedo up to a factor of {math.exp(found.half_width):.2f}, or its inverse"


def _range(values: Sequence[float], decimals: int) -> str:
    low, high = (f"{round(end, decimals) + 0.0:.{decimals}f}" for end in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


Scenes = dict[str, None]
"""Names of scenes in the order of the cells."""


def labels(cells: Sequence[tuple[CellRef, Result | None]], sweep: Sweep) -> list[Doubt]:
    """Remarks on the whole table from the ``labels`` among the facts of cells, with the rows that have them.

    Labels that all rows of a method share make one remark; labels of some rows make one remark per set of rows. A label
    that differs between scenes, or is missing for some, is followed by the scenes of each value.
    """
    texts = {row["key"]: row["text"] for row in sweep["rows"]}
    of_methods: dict[str, dict[str, dict[str, str]]] = {}
    for row in texts:
        own = [(ref["scene"], result) for ref, result in cells if ref["row"] == row and result is not None]
        if own:
            found = _labels_of([(scene, result["facts"].get("labels")) for scene, result in own])
            of_methods.setdefault(own[0][1]["cell"]["method"], {})[row] = found
    remarks: dict[str, list[str]] = {}
    for by_row in of_methods.values():
        first, *others = by_row.values()
        shared = {name: text for name, text in first.items() if all(each.get(name) == text for each in others)}
        for row, found in by_row.items():
            for part in (shared, {name: text for name, text in found.items() if name not in shared}):
                if part:
                    sentence = "; ".join(f"{name}: {text}" for name, text in part.items()) + "."
                    remarks.setdefault(sentence, []).append(row)
    return [
        Doubt(column="", rows=own, text=f"{', '.join(texts[key] for key in own)}: {text}")
        for text, own in remarks.items()
    ]


def _labels_of(found: Sequence[tuple[str, object]]) -> dict[str, str]:
    """The labels of a row's cells by name, each with its scenes if scenes differ."""
    values: dict[str, dict[str, Scenes]] = {}
    for scene, labels_of_cell in found:
        for name, value in labels_of_cell.items() if isinstance(labels_of_cell, Mapping) else ():
            values.setdefault(name, {}).setdefault(str(value), {})[scene] = None
    every = {scene for scene, _ in found}
    return {
        name: next(iter(by_value))
        if len(by_value) == 1 and all(set(scenes) == every for scenes in by_value.values())
        else ", ".join(f"{value} ({', '.join(scenes)})" for value, scenes in by_value.items())
        for name, by_value in values.items()
    }
