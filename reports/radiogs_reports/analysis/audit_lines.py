"""Lines of the audit: a scene under a row that leaves effects out, paired over seeds with the reference row.

A line also names in words the effects that its plan leaves out.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Literal, NamedTuple

from ..statistics import Estimate, Origin, mean_of, paired_difference, paired_ratio, shared_origins
from ..summary import RunSummary, Summary, last_stage, reference_of
from .samples import cost_of, runs_of

EXPERIMENT = "audit"

LOSSES: Mapping[str, str] = {"nvs": "nvs/psnr", "albedo": "albedo/psnr", "relight": "relight/psnr"}
"""Columns by the name of their loss, which is the fall of that PSNR in dB."""

Judgement = Literal["yes", "within noise", "no", "above"]
"""Whether a loss is under its bound; ``above``: the loss of a single seed, without an interval, is above it."""


class Line(NamedTuple):
    """Cost and savings of a row's plans on one scene, beside the reference row, which has all effects on.

    A value that the results do not hold is None.
    """

    scene: str
    row: str
    seeds: int
    probed: bool
    """Whether probes chose the plan."""
    losses: dict[str, Estimate | None]
    """Losses in dB by name as in ``LOSSES``, positive where the row is worse."""
    bound: float | None
    """Largest predicted loss over all probes and seeds, dB."""
    tolerance: float | None
    """Largest loss that probes were allowed, dB."""
    judgement: Judgement | None
    """Whether the loss is under the bound."""
    rays_saved: Estimate | None
    """1 - rays / the reference row's rays."""
    last_stage: Estimate | None
    """Seconds of the reference row's last stage over the row's."""
    training: Estimate | None
    """Seconds of the reference row's training over the row's."""
    probes_of_last_stage: Estimate | None
    """Seconds of probing over the seconds of the row's last stage."""
    probes_of_training: Estimate | None
    """Seconds of probing over the seconds of the row's training."""
    probe_rays: Estimate | None
    """Rays of probing over the reference row's rays."""
    left_out: str
    """The effects that the plan leaves out, in words."""


def audit_lines(summary: Summary) -> list[Line]:
    """All lines, scene by scene, over the seeds that a row and the reference row have both finished.

    Empty unless the run is an audit with a reference row.
    """
    audited = any(run["made_from"].get("experiment") == EXPERIMENT for run in summary["runs"])
    if not audited or summary["reference"] is None:
        return []
    full, lines = runs_of(summary, reference_of(summary)), []
    for scene in summary["scenes"]:
        for row in summary["rows"]:
            mine = {
                origin: run
                for origin, run in runs_of(summary, row["key"]).items()
                if origin.scene == scene and origin in full
            }
            if mine and all(chosen_effects(run) not in ("all", None) for run in mine.values()):
                lines.append(_line(scene, row["key"], mine, {origin: full[origin] for origin in mine}))
    return lines


def chosen_effects(run: RunSummary) -> str | list[str] | None:
    """``all``, ``auto`` or the names of the effects that are on; None for a method without such a choice."""
    chosen: str | list[str] | None = run["made_from"].get("variant", {}).get("effects")
    return chosen


def _line(scene: str, row: str, mine: Mapping[Origin, RunSummary], full: Mapping[Origin, RunSummary]) -> Line:
    plans = {origin: run["effects"] for origin, run in mine.items() if run["effects"] is not None}
    bounds = [plan["bound"] for plan in plans.values() if plan["bound"] is not None]
    tolerances = [plan["tolerance"] for plan in plans.values() if plan["tolerance"] is not None]
    probed = any(chosen_effects(run) == "auto" for run in mine.values())
    bound = max(bounds, default=None) if probed else None
    losses = {name: _loss(mine, full, column) for name, column in LOSSES.items()}
    probe_seconds, probe_rays = (
        _known(mine, partial(_probing, cost=cost)) if probed else {} for cost in ("seconds", "rays")
    )
    return Line(
        scene=scene,
        row=row,
        seeds=len(mine),
        probed=probed,
        losses=losses,
        bound=bound,
        tolerance=max(tolerances, default=None),
        judgement=judged(losses["nvs"], bound),
        rays_saved=share_saved(_known(mine, traced_rays), _known(full, traced_rays)),
        last_stage=paired_ratio(_known(full, last_stage_seconds), _known(mine, last_stage_seconds)),
        training=paired_ratio(_known(full, _training_seconds), _known(mine, _training_seconds)),
        probes_of_last_stage=share(probe_seconds, _known(mine, last_stage_seconds)),
        probes_of_training=share(probe_seconds, _known(mine, _training_seconds)),
        probe_rays=share(probe_rays, _known(full, traced_rays)),
        left_out=over_seeds({seed: left_out(plan["plan"]) for (_, seed, _), plan in plans.items()}),
    )


def judged(loss: Estimate | None, bound: float | None) -> Judgement | None:
    """Whether a loss is under a bound: by its mean, and otherwise by the low end of its interval."""
    if loss is None or bound is None:
        return None
    if loss.mean <= bound:
        return "yes"
    if loss.low is None:
        return "above"
    return "within noise" if loss.low <= bound else "no"


def share(part: Mapping[Origin, float], whole: Mapping[Origin, float]) -> Estimate | None:
    """Mean of part / whole, where both are known. An arithmetic mean, because the part may be zero."""
    return mean_of({each: part[each] / whole[each] for each in shared_origins(part, whole) if whole[each] > 0})


def share_saved(part: Mapping[Origin, float], whole: Mapping[Origin, float]) -> Estimate | None:
    """Mean of 1 - part / whole, where both are known."""
    return mean_of({each: 1 - part[each] / whole[each] for each in shared_origins(part, whole) if whole[each] > 0})


def traced_rays(run: RunSummary) -> float:
    """Rays traced in training; results leave out counters that are zero."""
    return cost_of(run, "rays") or 0.0


def last_stage_seconds(run: RunSummary) -> float | None:
    """Seconds of the last training stage."""
    stage = last_stage(run)
    return None if stage is None else run["seconds"].get(stage["name"])


def _loss(mine: Mapping[Origin, RunSummary], full: Mapping[Origin, RunSummary], column: str) -> Estimate | None:
    return paired_difference(*(_known(runs, lambda run: run["metrics"].get(column)) for runs in (full, mine)))


def _known(runs: Mapping[Origin, RunSummary], read: Callable[[RunSummary], float | None]) -> dict[Origin, float]:
    return {origin: value for origin, run in runs.items() if (value := read(run)) is not None}


def _training_seconds(run: RunSummary) -> float | None:
    return cost_of(run, "seconds")


def _probing(run: RunSummary, cost: str) -> float | None:
    effects = run["effects"]
    return None if effects is None or effects["probing"] is None else effects["probing"].get(cost)


HIGHEST_DEGREE = 3
"""Spherical-harmonics degree of a surfel's own radiance with nothing left out."""


def left_out(plan: Mapping[str, Any]) -> str:
    """The effects that a plan leaves out, such as ``no rays, lobes on 34 % of the surfels``.

    ``plan`` is as results store it: a mask is the share of surfels that it turns on. A field that it does not have
    leaves nothing out.
    """
    parts = [*_rays(plan), *_lobes(plan)]
    if not plan.get("bounces", True):
        parts.append("one bounce")
    if not plan.get("light_sampling", True):
        parts.append("no light sampling")
    if (degree := plan.get("sh_degree", HIGHEST_DEGREE)) < HIGHEST_DEGREE:
        parts.append(f"own radiance of degree {degree}")
    if (samples := plan.get("samples", 1)) > 1:
        parts.append(f"1/{samples} of the directions")
    if (refresh := plan.get("refresh", 1)) > 1:
        parts.append(f"all surfels re-traced 1/{refresh} as often")
    return ", ".join(parts) or "nothing"


def _rays(plan: Mapping[str, Any]) -> list[str]:
    visibility, indirect, traced = plan.get("visibility", True), plan.get("indirect", True), plan.get("traced")
    if not visibility and not indirect:
        return ["no rays"]
    parts = [] if traced is None else [f"rays from {100 * traced:.0f} % of the surfels"]
    if not visibility:
        parts.append("no visibility")
    if not indirect:
        parts.append("no indirect light")
    return parts


def _lobes(plan: Mapping[str, Any]) -> list[str]:
    if not plan.get("specular", True):
        return ["no lobes"]
    share = plan.get("specular_at")
    return [] if share is None else [f"lobes on {100 * share:.0f} % of the surfels"]


def over_seeds(texts: Mapping[int, str]) -> str:
    """Texts by seed as one: each different text once, with its seeds where there are several."""
    seeds_by_text: dict[str, list[int]] = {}
    for seed in sorted(texts):
        seeds_by_text.setdefault(texts[seed], []).append(seed)
    if len(seeds_by_text) <= 1:
        return "".join(seeds_by_text)
    return "; ".join(f"{text} ({_seeds(seeds)})" for text, seeds in seeds_by_text.items())


def _seeds(seeds: Sequence[int]) -> str:
    return f"seed{'' if len(seeds) == 1 else 's'} {', '.join(map(str, seeds))}"
