"""Results of the cost analysis as sentences; every number is computed from the summary."""

from ...statistics import Estimate
from ...summary import ColumnSummary, Summary, last_stage_title
from ...wording import plus_minus, signed
from .marginal import Doubling, Step
from .progress import second_half


def step_sentence(summary: Summary, step: Step) -> str:
    """Such as ``rays a surfel, N_s, 64 → 128: NVS PSNR +0.03 ± 0.05 dB, for 1.90 times the time.``"""
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
    """What a doubling of one knob changes in every column; ``doublings`` are of that knob."""
    first = doublings[0]
    changes = [change(each.slope, each.column) for each in doublings]
    cost = "" if first.time_ratio is None else f", for {first.time_ratio.mean:.2f} times the time"
    return f"Each doubling of {first.knob.text}: {', '.join(changes)}{cost}."


def second_half_sentence(summary: Summary) -> str | None:
    """What the second half of the last stage adds; None where nothing was scored during training."""
    found = [(column, second_half(summary, column["key"])) for column in summary["columns"]]
    known = [(column, each) for column, each in found if each is not None]
    if not known:
        return None
    changes = ", ".join(change(gain, column) for column, (gain, _) in known)
    share = 100 * known[0][1][1].mean
    return f"The second half of {last_stage_title(summary)}: {changes}, for {share:.0f} % of the training time."


def change(estimate: Estimate, column: ColumnSummary) -> str:
    """Label, signed difference, half-width of its interval if there is one, unit."""
    decimals = column["decimals"]
    text = plus_minus(signed(estimate.mean, decimals), estimate.half_width, decimals)
    return f"{column['label']} {text} {column['unit']}".rstrip()
