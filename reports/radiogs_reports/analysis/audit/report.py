"""The audit put together as sentences and a grid that every form of it shows."""

from collections import Counter
from typing import NamedTuple

from ...summary import Summary, reference_of
from ...write.grid import Grid, Item, factor, spread
from ...write.plain import count_of, signed_figure
from ..paired import Estimate
from .lines import LOSSES, Judgement, Line, audit_lines

SAID: dict[Judgement, str] = {
    "yes": "yes", "within noise": "within noise", "no": "no", "above": "above; one seed has no interval",
}  # fmt: skip

DECIMALS = 3
"""Of dB: bounds are a few hundredths."""

BY_HAND = "no probe: the effects were chosen by hand"
UNTIMED = "these results are from before probes were timed"


class AuditReport(NamedTuple):
    """All of it."""

    lines: list[Line]
    sentences: list[str]
    grid: Grid


def audit_report(summary: Summary) -> AuditReport | None:
    """The report of a run; None where it is no audit, or has no finished row that leaves effects out."""
    lines = audit_lines(summary)
    if not lines:
        return None
    texts = {row["key"]: row["text"] for row in summary["rows"]}
    sentences = []
    for row, text in texts.items():
        mine = [line for line in lines if line.row == row]
        sentences += [sentence for sentence in (_observed(text, mine), _judged(text, mine)) if sentence]
    return AuditReport(lines, sentences, _grid(summary, lines, texts))


def _observed(text: str, lines: list[Line]) -> str | None:
    """The least and the largest loss among the scenes."""
    found = sorted((loss.mean, line.scene) for line in lines if (loss := line.losses["nvs"]) is not None)
    if not found:
        return None
    (least, where), (most, there) = found[0], found[-1]
    text = f"{text}: NVS loss {signed_figure(least, DECIMALS)} dB ({where})"
    return f"{text}." if len(found) == 1 else f"{text} to {signed_figure(most, DECIMALS)} dB ({there})."


def _judged(text: str, lines: list[Line]) -> str | None:
    """In how many scenes the loss is under its bound, and within the tolerance with its whole interval."""
    counted = Counter(line.judgement for line in lines if line.judgement is not None)
    if not counted:
        return None
    said = f"{text}: NVS loss under the predicted bound in {counted['yes']} of {count_of(counted.total(), 'scene')}"
    for judgement in ("within noise", "above", "no"):
        if counted[judgement]:
            said += f", {judgement} in {counted[judgement]}"
    within = [
        loss.high <= line.tolerance for line in lines
        if line.tolerance is not None and (loss := line.losses["nvs"]) is not None and loss.high is not None
    ]  # fmt: skip
    if not within:
        return f"{said}."
    tolerance = max(line.tolerance for line in lines if line.tolerance is not None)
    return f"{said}; its 95 % interval is under the tolerance of {tolerance:g} dB in {sum(within)} of {len(within)}."


def _grid(summary: Summary, lines: list[Line], texts: dict[str, str]) -> Grid:
    reference = texts[reference_of(summary)]
    note = (
        f"Against '{reference}', paired over seeds; ± is the half-width of the 95 % t interval. Losses are positive"
        " where it is worse. The bound is the largest of all probes and seeds; rows whose effects were chosen by hand"
        " have none. Under it: yes, where the mean is; within noise, where the interval reaches under it. Rays saved:"
        " share of the reference's. Times as fast: geometric mean, with the ends of its interval. Probes: share of the"
        " seconds; n/a where the results do not hold it."
    )
    heads = ["scene", "row", *(f"{name} loss, dB" for name in ("NVS", "albedo", "relighting")), "predicted bound, dB",
             "NVS loss under it", "rays saved", "stage 2, times as fast", "training, times as fast",
             "probes, share of stage 2", "probes, share of training", "left out at the end"]  # fmt: skip
    rows = [
        [
            Item(line.scene, line.scene),
            Item(texts[line.row], texts[line.row]),
            *(_loss(line.losses[name]) for name in LOSSES),
            *_prediction(line),
            _share(line.rays, "everything on traces no rays either"),
            *(Item("n/a") if each is None else Item(factor(each), each.mean) for each in (line.stage2, line.training)),
            *(
                _share(each, UNTIMED) if line.probed else Item("none", None, BY_HAND)
                for each in (line.probes_of_stage2, line.probes_of_training)
            ),
            Item(line.left_out, line.left_out),
        ]
        for line in lines
    ]
    return Grid("audit", "What leaving effects out cost, and what it saved", note, heads, rows)


def _loss(loss: Estimate | None) -> Item:
    if loss is None:
        return Item("n/a", None, "the results have no such figure")
    return Item(spread(loss, DECIMALS, signed=True), loss.mean)


def _prediction(line: Line) -> tuple[Item, Item]:
    if not line.probed:
        return Item("none", None, BY_HAND), Item("by hand", "by hand")
    if line.bound is None:
        return Item("n/a", None, "the results hold no bound"), Item("n/a", "n/a")
    said = "n/a" if line.judgement is None else SAID[line.judgement]
    return Item(f"{line.bound:.{DECIMALS}f}", line.bound), Item(said, said)


def _share(share: Estimate | None, reason: str) -> Item:
    if share is None:
        return Item("n/a", None, reason)
    reach = "" if share.low is None or share.high is None else f" ± {100 * (share.high - share.low) / 2:.1f}"
    return Item(f"{100 * share.mean:.1f}{reach} %", share.mean)
