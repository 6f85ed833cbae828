"""A line of the audit: one scene under one row that leaves effects out, paired over seeds with everything on."""

from collections.abc import Callable, Mapping
from typing import Literal, NamedTuple

from ...summary import RunSummary, Summary, reference_of
from ..paired import Estimate, Pair, difference, estimate, ratio, runs_of
from ..pareto import cost_of
from .plan_text import left_out, over_seeds

EXPERIMENT = "audit"
STAGE = "invert"

LOSSES: Mapping[str, str] = {"nvs": "nvs/psnr", "albedo": "albedo/psnr", "relight": "relight/psnr"}
"""Columns whose fall, in dB, is a loss."""

Judgement = Literal["yes", "within noise", "no", "above"]
"""Whether the observed loss is under the bound; ``above`` where one seed alone lies above and no interval tells."""


class Line(NamedTuple):
    """What a row's plans have cost and saved on a scene.

    ``losses`` in dB, positive where it is worse than with everything on, by name as in ``LOSSES``. ``bound``: dB, the
    largest of all probes and seeds; None where nothing was probed. ``rays``: the share of everything's rays that is
    saved. ``stage2`` and ``training``: everything's seconds over the row's. ``probes_of_stage2`` and
    ``probes_of_training``: share of the row's seconds; ``probe_rays``: share of the rays of everything's.
    """

    scene: str
    row: str
    seeds: int
    probed: bool
    losses: dict[str, Estimate | None]
    bound: float | None
    tolerance: float | None
    judgement: Judgement | None
    rays: Estimate | None
    stage2: Estimate | None
    training: Estimate | None
    probes_of_stage2: Estimate | None
    probes_of_training: Estimate | None
    probe_rays: Estimate | None
    left_out: str


def audit_lines(summary: Summary) -> list[Line]:
    """All lines, scene by scene; none where the run is no audit.

    Only seeds that both the row and the reference row have finished count.
    """
    if not any(run["made_from"].get("experiment") == EXPERIMENT for run in summary["runs"]):
        return []
    full, lines = runs_of(summary, reference_of(summary)), []
    for scene in summary["scenes"]:
        for row in summary["rows"]:
            mine = {
                pair: run for pair, run in runs_of(summary, row["key"]).items() if pair[0] == scene and pair in full
            }
            if mine and all(chosen_effects(run) != "all" for run in mine.values()):
                lines.append(_line(scene, row["key"], mine, {pair: full[pair] for pair in mine}))
    return lines


def chosen_effects(run: RunSummary) -> str | list[str]:
    """``all``, ``auto`` or the names of the effects that are on."""
    chosen: str | list[str] = run["made_from"]["variant"]["effects"]
    return chosen


def _line(scene: str, row: str, mine: Mapping[Pair, RunSummary], full: Mapping[Pair, RunSummary]) -> Line:
    plans = {pair: run["effects"] for pair, run in mine.items() if run["effects"] is not None}
    bounds = [plan["bound"] for plan in plans.values() if plan["bound"] is not None]
    tolerances = [plan["tolerance"] for plan in plans.values() if plan["tolerance"] is not None]
    probed = any(chosen_effects(run) == "auto" for run in mine.values())
    bound = max(bounds, default=None) if probed else None
    losses = {name: _loss(mine, full, column) for name, column in LOSSES.items()}
    return Line(
        scene=scene,
        row=row,
        seeds=len(mine),
        probed=probed,
        losses=losses,
        bound=bound,
        tolerance=max(tolerances, default=None),
        judgement=judged(losses["nvs"], bound),
        rays=share(_known(mine, traced_rays), _known(full, traced_rays), saved=True),
        stage2=ratio(_known(full, stage_seconds), _known(mine, stage_seconds)),
        training=ratio(_known(full, _training), _known(mine, _training)),
        probes_of_stage2=share(_known(mine, _probe_seconds), _known(mine, stage_seconds)) if probed else None,
        probes_of_training=share(_known(mine, _probe_seconds), _known(mine, _training)) if probed else None,
        probe_rays=share(_known(mine, _probe_rays), _known(full, traced_rays)) if probed else None,
        left_out=over_seeds({seed: left_out(plan["plan"]) for (_, seed), plan in plans.items()}),
    )


def judged(loss: Estimate | None, bound: float | None) -> Judgement | None:
    """Whether a loss is under a bound: its mean, or at least its interval."""
    if loss is None or bound is None:
        return None
    if loss.mean <= bound:
        return "yes"
    if loss.low is None:
        return "above"
    return "within noise" if loss.low <= bound else "no"


def share(part: Mapping[Pair, float], whole: Mapping[Pair, float], *, saved: bool = False) -> Estimate | None:
    """The part of the whole, or what it lacks of it. Not a ratio of the whole to the part: that may be nothing."""
    shares = [part[pair] / whole[pair] for pair in sorted(part.keys() & whole.keys()) if whole[pair] > 0]
    return estimate([1 - each if saved else each for each in shares])


def _loss(mine: Mapping[Pair, RunSummary], full: Mapping[Pair, RunSummary], column: str) -> Estimate | None:
    return difference(*(_known(runs, lambda run: run["figures"].get(column)) for runs in (full, mine)))


def _known(runs: Mapping[Pair, RunSummary], read: Callable[[RunSummary], float | None]) -> dict[Pair, float]:
    return {pair: value for pair, run in runs.items() if (value := read(run)) is not None}


def traced_rays(run: RunSummary) -> float:
    """Rays of training; counters that stand at nothing may be absent."""
    return cost_of(run, "rays") or 0.0


def stage_seconds(run: RunSummary) -> float | None:
    """Of stage 2."""
    return run["seconds"].get(STAGE)


def _training(run: RunSummary) -> float | None:
    return cost_of(run, "seconds")


def _probing(run: RunSummary, what: str) -> float | None:
    return None if run["effects"] is None or run["effects"]["probing"] is None else run["effects"]["probing"][what]


def _probe_seconds(run: RunSummary) -> float | None:
    return _probing(run, "seconds")


def _probe_rays(run: RunSummary) -> float | None:
    return _probing(run, "rays")
