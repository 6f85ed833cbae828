"""The oracle ladder: the share of each part of the truth in each metric."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ..statistics import Estimate, Origin, mean_of, paired_difference
from ..summary import ColumnSummary, Summary, directed_columns
from ..wording import heading, label_with_unit, marked, signed
from .report import Grid, Record, Report, estimate_fields, estimate_item, name_item, plain_item
from .samples import values_of

ALL_SCENES = "all scenes"

ENDS = ("first in", "last out")
"""The names of the values of a ``Share``."""

OWN: Mapping[str, str] = {
    "geometry": "normal", "light": "environment", "albedo": "albedo", "roughness": "roughness",
}  # fmt: skip
"""Task of the metrics that measure a part itself: giving the part fixes them, however good the rest is."""

WHAT_THEY_MEAN = (
    "First in: what a metric gains when this part alone is given, compared with nothing given. Last out: what it loses"
    " when this part alone is left out, compared with everything given. Both are positive where the truth of the part"
    " makes the metric better, in the metric's own unit. They are the two ends of what a part is responsible for: first"
    " in, all other parts are as wrong as the method leaves them; last out, all others are right. A part that is worth"
    " more last out is held back by the others; one that is worth more first in makes up for their errors, or they for"
    " its. The values of the parts do not add up to the whole difference. Where a metric measures a part itself, giving"
    " that part settles it: everything given then means all but that part, which has its own values in parentheses."
)


class Share(NamedTuple):
    """The values of one part, first in and last out (``WHAT_THEY_MEAN``); None if a required row has no values."""

    first_in: Estimate | None
    last_out: Estimate | None


class Rung(NamedTuple):
    """A metric on a scene, or over all: its value with nothing and with everything given, and the parts' shares."""

    method: str
    scene: str
    column: ColumnSummary
    nothing: Estimate | None
    everything: Estimate | None
    """Value with everything given except the part that the metric measures itself (``OWN``)."""
    parts: dict[str, Share]


def ladder_report(summary: Summary) -> Report | None:
    """The report of a run; None unless its rows give parts of the truth and one of them is finished."""
    rungs = ladder_rungs(summary)
    if not rungs:
        return None
    several = len({rung.method for rung in rungs}) > 1
    shown = [rung for rung in rungs if rung.scene == ALL_SCENES or len(summary["scenes"]) == 1]
    sentences = [sentence for rung in shown if (sentence := _sentence(rung, several))]
    records = [record for rung in rungs for record in _records(rung)]
    return Report([WHAT_THEY_MEAN, *sentences], [_grid(summary, rungs, several)], records)


def _records(rung: Rung) -> list[Record]:
    named = {"method": rung.method, "scene": rung.scene, "metric": rung.column["key"]}
    return [
        {**named, "part": part}
        | estimate_fields(
            nothing_given=rung.nothing,
            first_in=share.first_in,
            last_out=share.last_out,
            everything_given=rung.everything,
        )
        for part, share in rung.parts.items()
    ]


def ladder_rungs(summary: Summary) -> list[Rung]:
    """Method by method and scene by scene (then over all scenes, if there are several), a rung for each metric."""
    scenes: list[tuple[str, ...]] = [(scene,) for scene in summary["scenes"]]
    if len(scenes) > 1:
        scenes.append(tuple(summary["scenes"]))
    found = []
    for method, rows in _ladders(summary).items():
        for chosen in scenes:
            for column in directed_columns(summary):
                values = {
                    given: {
                        at: value for at, value in values_of(summary, row, column["key"]).items() if at.scene in chosen
                    }
                    for given, row in rows.items()
                }
                if any(values.values()):
                    name = chosen[0] if len(chosen) == 1 else ALL_SCENES
                    found.append(_rung(method, name, column, values))
    return found


def is_own(part: str, column: ColumnSummary) -> bool:
    """Whether a metric measures the part itself."""
    return column["key"].partition("/")[0] == OWN.get(part)


def _ladders(summary: Summary) -> dict[str, dict[frozenset[str], str]]:
    """The row of every choice of given parts, by method, smaller choices first."""
    ladders: dict[str, dict[frozenset[str], str]] = {}
    for row in summary["rows"]:
        if "given" in row:
            ladders.setdefault(row.get("method", ""), {})[frozenset(row["given"])] = row["key"]
    return ladders


def _rung(
    method: str, scene: str, column: ColumnSummary, values: Mapping[frozenset[str], Mapping[Origin, float]]
) -> Rung:
    none, whole = frozenset[str](), frozenset[str]().union(*values)
    own = frozenset(part for part in whole if is_own(part, column))

    def gain(better: frozenset[str], worse: frozenset[str]) -> Estimate | None:
        pair = (values.get(better, {}), values.get(worse, {}))
        return paired_difference(*(pair if column["direction"] == "up" else reversed(pair)))

    singles = [part for given in values if len(given) == 1 for part in given]
    return Rung(
        method,
        scene,
        column,
        mean_of(values.get(none, {})),
        mean_of(values.get(whole - own, {})),
        {
            part: Share(gain(frozenset({part}), none), gain(whole - (own - {part}), whole - own - {part}))
            for part in singles
        },
    )


def _sentence(rung: Rung, several: bool) -> str | None:
    """The parts that are worth most first in and last out, except the part that the metric measures itself."""
    if rung.nothing is None or rung.everything is None:
        return None
    decimals = rung.column["decimals"]
    others = {part: share for part, share in rung.parts.items() if not is_own(part, rung.column)}
    most = []
    for place, name in enumerate(ENDS):
        known = {part: end.mean for part, share in others.items() if (end := share[place]) is not None}
        part = max(known, key=lambda each: known[each], default=None)
        if part is not None and round(known[part], decimals) > 0:
            most.append(f"{name}, {part} counts most ({signed(known[part], decimals)})")
        elif part is not None:
            most.append(f"{name}, no other part makes it better")
    own = " and ".join(f"but {part}" for part in rung.parts if is_own(part, rung.column))
    values = f"{rung.nothing.mean:.{decimals}f} with nothing given, {rung.everything.mean:.{decimals}f} with everything"
    values = f"{values} {own}".rstrip()
    return f"{_place(rung, several)}, {label_with_unit(rung.column)}: {'; '.join([values, *most])}."


def _grid(summary: Summary, rungs: Sequence[Rung], several: bool) -> Grid:
    parts = list(dict.fromkeys(part for rung in rungs for part in rung.parts))
    heads = ["scene", "metric", "nothing given", *(f"{part}, {end}" for part in parts for end in ENDS)]
    rows = []
    for rung in rungs:
        decimals, place = rung.column["decimals"], _place(rung._replace(scene=marked(summary, rung.scene)), several)
        line = [name_item(place), name_item(heading(rung.column))]
        line.append(plain_item(rung.nothing, decimals))
        for part in parts:
            for end in rung.parts.get(part, Share(None, None)):
                item = estimate_item(end, decimals)
                own = end is not None and is_own(part, rung.column)
                line.append(item._replace(text=f"({item.text})") if own else item)
        rows.append([*line, plain_item(rung.everything, decimals)])
    note = (
        f"{WHAT_THEY_MEAN} Paired by scene and seed; ± is the half-width of the 95 % t interval: over the seeds of the"
        " scene, or over scenes, each with the mean over its seeds, in the lines of all scenes. n/a: a row that the"
        " value is made from has not been run."
    )
    title = "What each part is responsible for"
    return Grid("ladder", title, note, [*heads, "everything given"], rows)


def _place(rung: Rung, several: bool) -> str:
    return f"{rung.scene}, {rung.method}" if several else rung.scene
