"""This run beside another run of the same rows: differences in settings, and whether values differ.

The other run is stored in the summary as ``OtherRun``, so that reports are made from the summary alone.
"""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from ..statistics import Estimate, Origin, Sample, mean_of
from ..summary import ColumnSummary, OtherRun, Summary, Verdict, protocol_title, row_texts
from ..wording import count_of, heading
from .comparisons import compared
from .report import Grid, Report, estimate_fields, estimate_item, name_item, plain_item
from .samples import changed_fields, flat, made_from, runs_of, values_of

MOST_CHANGES = 8
"""Most settings of a row that are named; further ones are counted."""

ABSENT = "no setting"


class Beside(NamedTuple):
    """A value of a row in both runs."""

    row: str
    column: ColumnSummary
    there: Estimate | None
    """Mean of the other run over the scenes and seeds that both runs have."""
    here: Estimate | None
    difference: Estimate
    """This run minus the other, paired by scene and seed."""
    verdict: Verdict | None
    """Whether this run is resolved to be better: paired t tests with Holm's correction over the rows of the column."""
    equal: bool
    """Whether all pairs are equal to the last bit."""


def other_run(other: Summary, name: str, origin: Mapping[str, str]) -> OtherRun:
    """The part of another run's summary that a comparison needs.

    ``name``: of its folder. ``origin``: its dates, commits and command by heading.
    """
    return OtherRun(
        name=name,
        origin=dict(origin),
        protocol=protocol_title(other),
        settings={row["key"]: _settings(other, row["key"]) for row in other["rows"]},
        values=[
            {
                "row": run["row"],
                "scene": run["scene"],
                "seed": run["seed"],
                "checksum": run["made_from"].get("checksum", ""),
                "metrics": run["metrics"],
            }
            for run in other["runs"]
            if run["metrics"]
        ],
    )


def beside_report(summary: Summary) -> Report | None:
    """The comparison with the other run of the summary; None without one."""
    other = summary.get("beside")
    if other is None:
        return None
    known = ", ".join(f"{name.lower()} {text}" for name, text in other["origin"].items())
    about = f"Other run: {other['name']} ({known})."
    values = [each for column in summary["columns"] for each in compared_values(summary, other, column)]
    sentences = [about, *_paired(summary, other), *_in_words(summary, values), *_changes(summary, other)]
    records = [
        {"row": each.row, "metric": each.column["key"]}
        | estimate_fields(there=each.there, here=each.here, difference=each.difference)
        | {"verdict": each.verdict, "equal": each.equal}
        for each in values
    ]
    return Report(sentences, [_grid(summary, other, values)], records)


def compared_values(summary: Summary, other: OtherRun, column: ColumnSummary) -> Iterator[Beside]:
    """The values of a column in the rows that share a scene and seed with the other run."""
    pairs = {row: _shared(summary, other, row, column["key"]) for row in row_texts(summary)}
    for row, found in compared(pairs, column["direction"]).items():
        here, there = pairs[row]
        yield Beside(row, column, mean_of(there), mean_of(here), found.difference, found.verdict, here == there)


def _shared(summary: Summary, other: OtherRun, row: str, column: str) -> tuple[Sample, Sample]:
    """Values of a row in this run and in the other, at the scenes and seeds that both have with the same files."""
    here, runs = values_of(summary, row, column), runs_of(summary, row)
    places = {(at.scene, at.seed, runs[at]["made_from"].get("checksum", "")): at for at in here}
    there: dict[Origin, float] = {}
    for each in other["values"]:
        place = places.get((each["scene"], each["seed"], each["checksum"])) if each["row"] == row else None
        value = each["metrics"].get(column)
        if place is not None and value is not None:
            there[place] = value
    return {place: here[place] for place in there}, there


def _paired(summary: Summary, other: OtherRun) -> Iterator[str]:
    """How many cells have a counterpart, and which scenes have other files there."""
    here = {(run["row"], run["scene"], run["seed"]): run for run in summary["runs"] if run["metrics"]}
    there = {(each["row"], each["scene"], each["seed"]): each for each in other["values"]}
    both = here.keys() & there.keys()
    yield (
        f"{count_of(len(both), 'cell')} of both; {len(here) - len(both)} of this run alone, {len(there) - len(both)} of"
        " the other alone."
    )
    odd = {at[1] for at in both if here[at]["made_from"].get("checksum", "") != there[at]["checksum"]}
    if odd:
        yield f"Not compared, because its files or how it was opened differ: {', '.join(sorted(odd))}."


def _in_words(summary: Summary, values: list[Beside]) -> Iterator[str]:
    """For each row the columns in which it is better, worse, equal, and not resolved."""
    for row, text in row_texts(summary).items():
        said: dict[str, list[str]] = {"better": [], "worse": [], "equal to the last bit": [], "not resolved": []}
        for each in (each for each in values if each.row == row):
            label = each.column["label"]
            measured = f"{label} {estimate_item(each.difference, each.column['decimals']).text}"
            if each.verdict is not None:
                said[each.verdict].append(measured)
            if each.equal:
                said["equal to the last bit"].append(label)
            elif each.verdict is None:
                said["not resolved"].append(measured)
        told = [f"{outcome}: {', '.join(columns)}" for outcome, columns in said.items() if columns]
        if told:
            yield f"{text}: {'; '.join(told)}."


def _changes(summary: Summary, other: OtherRun) -> Iterator[str]:
    """The settings that differ, row by row."""
    for row, text in row_texts(summary).items():
        if row in other["settings"]:
            here, there = _settings(summary, row), other["settings"][row]
            if here and there:
                names = sorted(changed_fields(here, there))
                said = [f"{name} {there.get(name, ABSENT)} there, {here.get(name, ABSENT)} here" for name in names]
                more = len(said) - MOST_CHANGES
                tail = [f"and {count_of(more, 'other')}"] if more > 0 else []
                if said:
                    yield f"{text}, settings: {'; '.join([*said[:MOST_CHANGES], *tail])}."


def _settings(summary: Summary, row: str) -> dict[str, Any]:
    """Method, variant and budget of a row by dotted name; empty without a finished cell."""
    content: Mapping[str, Any] = made_from(summary, row) or {}
    return flat({name: content[name] for name in ("method", "variant", "budget") if name in content})


def _grid(summary: Summary, other: OtherRun, values: list[Beside]) -> Grid:
    texts = row_texts(summary)
    rows = [
        [
            name_item(texts[each.row]),
            name_item(heading(each.column)),
            plain_item(each.there, each.column["decimals"]),
            plain_item(each.here, each.column["decimals"]),
            estimate_item(each.difference, each.column["decimals"]),
            name_item("equal" if each.equal else each.verdict or "not resolved"),
        ]
        for each in values
    ]
    note = (
        "Means over the scenes and seeds that both runs have. Difference: this run minus the other, paired by scene and"
        " seed; ± is the half-width of the 95 % t interval, and without it there is only one unit to compare. Better,"
        " or worse: paired t tests with Holm's correction over the rows of a metric."
    )
    heads = ["row", "metric", other["name"], "this run", "difference", "this run is"]
    return Grid("beside", f"This run beside {other['name']}", note, heads, rows)
