"""Sentences that state results, with every figure computed from the summary."""

from ...summary import ColumnSummary, Summary
from ...write.plain import signed_figure
from ..paired import Estimate
from .marginal import Doubling, Step
from .progress import second_half


def step_sentence(summary: Summary, step: Step) -> str:
    """Such as: rays a surfel, N_s, 64 → 128: NVS PSNR +0.03 ± 0.05 dB, for 1.90 times the time."""
    changes = [
        change(step.differences[column["key"]], column)
        for column in summary["columns"]
        if column["key"] in step.differences
    ]
    text = f"{step.knob.text}, {step.low.value} → {step.high.value}: {', '.join(changes)}"
    if step.times is not None:
        text += f", for {step.times.mean:.2f} times the time"
    if step.rays is not None:
        text += f" and {step.rays.mean:.2f} times the rays"
    return f"{text}."


def doubling_sentence(knob: list[Doubling]) -> str:
    """What a doubling of one knob does to every column; ``knob`` are its doublings."""
    changes = [change(each.slope, each.column) for each in knob]
    times = knob[0].times
    cost = "" if times is None else f", for {times.mean:.2f} times the time"
    return f"Each doubling of {knob[0].knob.text}: {', '.join(changes)}{cost}."


def second_half_sentence(summary: Summary) -> str | None:
    """What the last half of the iterations is worth; None where nothing was scored along the way."""
    found = [(column, second_half(summary, column["key"])) for column in summary["columns"]]
    known = [(column, each) for column, each in found if each is not None]
    if not known:
        return None
    changes = ", ".join(change(gain, column) for column, (gain, _) in known)
    return f"The second half of stage 2: {changes}, for {100 * known[0][1][1].mean:.0f} % of the training time."


def change(estimate: Estimate, column: ColumnSummary) -> str:
    """Label, difference with the half-width of its interval if there is one, unit."""
    digits = column["decimals"]
    text = f"{column['label']} {signed_figure(estimate.mean, digits)}"
    if estimate.low is not None and estimate.high is not None:
        text += f" ± {(estimate.high - estimate.low) / 2:.{digits}f}"
    return f"{text} {column['unit']}".rstrip()
