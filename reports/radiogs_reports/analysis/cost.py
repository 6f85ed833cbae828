"""The cost of accuracy: gain and cost of each knob of the budget, from a run's summary alone."""

from collections.abc import Iterator, Sequence
from itertools import groupby

from ..statistics import Estimate
from ..summary import ColumnSummary, Summary, last_stage_title, reference_of, row_texts
from .cost_grids import PARTED, cost_grids, efficiencies, variance_share
from .cost_knobs import Doubling, KnobStep, doublings, knobs, steps
from .cost_progress import second_half
from .pareto import points
from .report import Record, Report, estimate_item
from .samples import COSTS


def cost_report(summary: Summary) -> Report | None:
    """The report of a run; None unless some rows differ from the reference row in a single field of the budget."""
    turned = knobs(summary)
    if not turned:
        return None
    taken, slopes = steps(summary, turned), doublings(summary, turned)
    sentences = [step_sentence(summary, each) for each in taken if each.differences]
    sentences += [doubling_sentence(list(each)) for _, each in groupby(slopes, key=lambda each: each.knob)]
    sentences += [each for each in (second_half_sentence(summary), error_parts_sentence(summary)) if each is not None]
    return Report(sentences, cost_grids(summary, turned, slopes), list(_records(summary, taken, slopes)))


def step_sentence(summary: Summary, step: KnobStep) -> str:
    """One step of a knob: ``rays a surfel, N_s, 64 → 128: NVS PSNR +0.03 ± 0.05 dB, for 1.90 times the time.``"""
    changes = [
        change(step.differences[column["key"]], column)
        for column in summary["columns"]
        if column["key"] in step.differences
    ]
    text = f"{step.knob.text}, {step.low.value} → {step.high.value}: {', '.join(changes)}"
    if step.time_ratio is not None:
        text += f", for {step.time_ratio.mean:.2f} times the time"
    if step.ray_ratio is not None:
        text += f" and {step.ray_ratio.mean:.2f} times the rays"
    return f"{text}."


def doubling_sentence(doublings: list[Doubling]) -> str:
    """The change of every column per doubling of a knob; all ``doublings`` belong to this knob."""
    first = doublings[0]
    changes = [change(each.slope, each.column) for each in doublings]
    cost = "" if first.time_ratio is None else f", for {first.time_ratio.mean:.2f} times the time"
    return f"Each doubling of {first.knob.text}: {', '.join(changes)}{cost}."


def second_half_sentence(summary: Summary) -> str | None:
    """The gain of the second half of the last stage; None without scores during training."""
    found = [(column, second_half(summary, column["key"])) for column in summary["columns"]]
    known = [(column, each) for column, each in found if each is not None]
    if not known:
        return None
    changes = ", ".join(change(gain, column) for column, (gain, _) in known)
    share = 100 * known[0][1][1].mean
    return f"The second half of {last_stage_title(summary)}: {changes}, for {share:.0f} % of the training time."


def error_parts_sentence(summary: Summary) -> str | None:
    """The share of the reference row's error that differs between seeds; None without a scene of several seeds."""
    parts = summary.get("error_parts", {}).get(reference_of(summary))
    if not parts:
        return None
    said = ", ".join(f"{PARTED[kind]} {variance_share(each):.0f} %" for kind, each in parts.items() if kind in PARTED)
    return (
        f"Variance between seeds is this share of the squared error of '{row_texts(summary)[reference_of(summary)]}':"
        f" {said}. The rest is the same for every seed."
    )


def change(estimate: Estimate, column: ColumnSummary) -> str:
    """Label, signed difference, half-width of its interval if there is one, unit."""
    return f"{column['label']} {estimate_item(estimate, column['decimals']).text} {column['unit']}".rstrip()


def _records(summary: Summary, taken: Sequence[KnobStep], slopes: Sequence[Doubling]) -> Iterator[Record]:
    """Every point, step, slope and efficiency, with the ends of its interval; means of a row have no interval."""
    for column in summary["columns"]:
        for cost in COSTS:
            for point in points(summary, column, cost):
                place = "on the front" if point.on_front else "beaten"
                count = summary["cells"][point.row][column["key"]]["count"]
                spent, quality = (Estimate(mean, None, None, 1, values=count) for mean in (point.cost, point.quality))
                yield _record(f"point, {cost}", point.row, place, column["key"], spent)
                yield _record("point, value", point.row, cost, column["key"], quality)
    for step in taken:
        what = f"step of {step.knob.field}"
        for key, difference in step.differences.items():
            yield _record(what, step.high.row, step.low.row, key, difference)
        for cost, ratio in (("seconds", step.time_ratio), ("rays", step.ray_ratio)):
            if ratio is not None:
                yield _record(f"{what}, ratio", step.high.row, step.low.row, cost, ratio)
    for each in slopes:
        yield _record("slope per doubling", each.knob.field, "", each.column["key"], each.slope)
    for (row, key), ratio in efficiencies(summary).items():
        yield _record("efficiency", row, reference_of(summary), key, ratio)


def _record(what: str, row: str, versus: str, column: str, value: Estimate) -> Record:
    return {
        "what": what, "row": row, "versus": versus, "column": column, "value": value.mean, "low": value.low,
        "high": value.high, "over": value.over, "units": value.units, "count": value.values,
    }  # fmt: skip
