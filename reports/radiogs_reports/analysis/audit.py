"""The audit of plans: the cost of leaving effects out beside its prediction, from a run's summary alone."""

from collections import Counter

from ..summary import Summary, last_stage_title, reference_of, row_texts
from ..wording import count_of, marked, signed
from .audit_lines import LOSSES, AuditLine, audit_lines
from .report import Grid, Item, Record, Report, estimate_fields, estimate_item, factor_item, name_item, share_item

DECIMALS = 3
"""Printed decimals of dB: bounds are a few hundredths."""

BY_HAND = "no probe: the effects were chosen by hand"
UNTIMED = "these results are from before probes were timed"


def audit_report(summary: Summary) -> Report | None:
    """The report of a run; None unless it is an audit with a finished row that leaves effects out."""
    lines = audit_lines(summary)
    if not lines:
        return None
    texts = row_texts(summary)
    sentences = []
    for row, text in texts.items():
        mine = [line for line in lines if line.row == row]
        if found := sorted((loss.mean, line.scene) for line in mine if (loss := line.losses["nvs"]) is not None):
            ends = dict.fromkeys((found[0], found[-1]))
            losses = " to ".join(f"{signed(loss, DECIMALS)} dB ({scene})" for loss, scene in ends)
            sentences.append(f"{text}: NVS loss {losses}.")
        if (bounded := _bound_sentence(text, mine)) is not None:
            sentences.append(bounded)
    return Report(sentences, [_grid(summary, lines, texts)], [_record(line) for line in lines])


def _bound_sentence(text: str, lines: list[AuditLine]) -> str | None:
    """The number of scenes whose loss is below its bound, and of scenes whose whole interval is below the tolerance."""
    counted = Counter(line.judgement for line in lines if line.judgement is not None)
    if not counted:
        return None
    sentence = f"{text}: NVS loss under the predicted bound in {counted['yes']} of {count_of(counted.total(), 'scene')}"
    for judgement in ("within noise", "above", "no"):
        if counted[judgement]:
            sentence += f", {judgement} in {counted[judgement]}"
    within = [
        loss.high <= line.tolerance for line in lines
        if line.tolerance is not None and (loss := line.losses["nvs"]) is not None and loss.high is not None
    ]  # fmt: skip
    if not within:
        return f"{sentence}."
    tolerance = max(line.tolerance for line in lines if line.tolerance is not None)
    return (
        f"{sentence}; its 95 % interval is under the tolerance of {tolerance:g} dB in {sum(within)} of {len(within)}."
    )


def _grid(summary: Summary, lines: list[AuditLine], texts: dict[str, str]) -> Grid:
    note = (
        f"Compared with '{texts[reference_of(summary)]}', paired by seed; ± is the half-width of the 95 % t"
        " interval over the seeds of that scene, and of that scene alone. A positive loss means worse. The bound is the"
        " largest of all probes and seeds; rows whose effects were chosen by hand have none. NVS loss under it: yes, if"
        " the mean is; within noise, if the low end of the interval is. Rays saved: share of the reference's. Times as"
        " fast: geometric mean, with the ends of its interval. Probes: share of the seconds; n/a where the results do"
        " not hold it."
    )
    last = last_stage_title(summary)
    heads = ["scene", "row", *(f"{name} loss, dB" for name in ("NVS", "albedo", "relighting")), "predicted bound, dB",
             "NVS loss under it", "rays saved", f"{last}, times as fast", "training, times as fast",
             f"probes, share of {last}", "probes, share of training", "left out at the end"]  # fmt: skip
    rows = [
        [
            name_item(marked(summary, line.scene)),
            name_item(texts[line.row]),
            *(estimate_item(line.losses[name], DECIMALS, "the results have no such value") for name in LOSSES),
            *_prediction(line),
            share_item(line.shares["rays_saved"], "the reference traces no rays either"),
            *(factor_item(line.shares[f"{name}_times_as_fast"]) for name in ("last_stage", "training")),
            *(
                share_item(line.shares[name], UNTIMED) if line.probed else Item("none", None, BY_HAND)
                for name in ("probes_of_last_stage", "probes_of_training")
            ),
            name_item(line.left_out) if line.left_out else Item("n/a", None, "the results hold no plan"),
        ]
        for line in lines
    ]
    return Grid("audit", "What leaving effects out cost, and what it saved", note, heads, rows)


def _prediction(line: AuditLine) -> tuple[Item, Item]:
    """The bound, and whether the loss is under it."""
    if not line.probed:
        return Item("none", None, BY_HAND), name_item("by hand")
    if line.bound is None:
        return Item("n/a", None, "the results hold no bound"), name_item("n/a")
    text = "above; one seed has no interval" if line.judgement == "above" else line.judgement or "n/a"
    return Item(f"{line.bound:.{DECIMALS}f}", line.bound), name_item(text)


def _record(line: AuditLine) -> Record:
    """A scene and row; shares are between 0 and 1."""
    named: Record = {
        "scene": line.scene, "row": line.row, "seeds": line.seeds, "bound": line.bound, "tolerance": line.tolerance,
        "under_bound": line.judgement, "left_out": line.left_out,
    }  # fmt: skip
    losses = {f"{name}_loss": loss for name, loss in line.losses.items()}
    return named | estimate_fields(**losses, **line.shares)
