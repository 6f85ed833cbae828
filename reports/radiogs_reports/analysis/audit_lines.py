"""Lines of the audit: a scene under a row that leaves effects out, paired over seeds with the reference row."""

from collections.abc import Mapping
from functools import partial
from typing import Any, Literal, NamedTuple

from ..statistics import Estimate, Origin, mean_of, paired_difference, paired_ratio, shared_origins
from ..summary import RunSummary, Summary, last_stage, reference_of
from .samples import cost_of, known, runs_of

EXPERIMENT = "audit"

LOSSES: Mapping[str, str] = {"nvs": "nvs/psnr", "albedo": "albedo/psnr", "relight": "relight/psnr"}
"""Columns by the name of their loss: the decrease of the column's PSNR in dB."""

Judgement = Literal["yes", "within noise", "no", "above"]
"""Whether a loss is under its bound; ``above``: it is above, but from a single seed, without an interval."""


class AuditLine(NamedTuple):
    """Cost and savings of a row's plans on one scene against the reference row (all effects); None if unknown."""

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
    shares: dict[str, Estimate | None]
    """By name: rays saved and rays of probing, as shares of the reference row's rays; speed-ups of the last stage and
    of the training over the reference row's; seconds of probing, as a share of the row's own."""
    left_out: str
    """The effects that the plan leaves out, in words."""


def audit_lines(summary: Summary) -> list[AuditLine]:
    """All lines of an audit with a reference row, scene by scene, over the seeds that both rows have finished."""
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


def _metric(run: RunSummary, key: str) -> float | None:
    return run["metrics"].get(key)


def _line(scene: str, row: str, mine: Mapping[Origin, RunSummary], full: Mapping[Origin, RunSummary]) -> AuditLine:
    plans = {origin: run["effects"] for origin, run in mine.items() if run["effects"] is not None}
    bounds = [plan["bound"] for plan in plans.values() if plan["bound"] is not None]
    tolerances = [plan["tolerance"] for plan in plans.values() if plan["tolerance"] is not None]
    probed = any(chosen_effects(run) == "auto" for run in mine.values())
    bound = max(bounds, default=None) if probed else None
    losses = {
        name: paired_difference(*(known(runs, partial(_metric, key=key)) for runs in (full, mine)))
        for name, key in LOSSES.items()
    }
    rays, full_rays = (known(runs, lambda run: cost_of(run, "rays") or 0.0) for runs in (mine, full))
    stage, full_stage = (known(runs, last_stage_seconds) for runs in (mine, full))
    training, full_training = (known(runs, partial(cost_of, cost="seconds")) for runs in (mine, full))
    probe_seconds, probe_rays = (
        known(mine, partial(_probing, cost=cost)) if probed else {} for cost in ("seconds", "rays")
    )
    return AuditLine(
        scene=scene,
        row=row,
        seeds=len(mine),
        probed=probed,
        losses=losses,
        bound=bound,
        tolerance=max(tolerances, default=None),
        judgement=judged(losses["nvs"], bound),
        shares={
            "rays_saved": mean_of({at: 1 - share for at, share in shares_of(rays, full_rays).items()}),
            "last_stage_times_as_fast": paired_ratio(full_stage, stage),
            "training_times_as_fast": paired_ratio(full_training, training),
            "probes_of_last_stage": mean_of(shares_of(probe_seconds, stage)),
            "probes_of_training": mean_of(shares_of(probe_seconds, training)),
            "probe_rays_share": mean_of(shares_of(probe_rays, full_rays)),
        },
        left_out=over_seeds({seed: left_out(plan["plan"]) for (_, seed, *_), plan in plans.items()}),
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


def shares_of(part: Mapping[Origin, float], whole: Mapping[Origin, float]) -> dict[Origin, float]:
    """Part / whole, where both are known. Their mean is arithmetic, because a part may be zero."""
    return {each: part[each] / whole[each] for each in shared_origins(part, whole) if whole[each] > 0}


def last_stage_seconds(run: RunSummary) -> float | None:
    """Seconds of the last training stage."""
    stage = last_stage(run)
    return None if stage is None else run["seconds"].get(stage["name"])


def _probing(run: RunSummary, cost: str) -> float | None:
    effects = run["effects"]
    return None if effects is None or effects["probing"] is None else effects["probing"].get(cost)


HIGHEST_DEGREE = 3
"""Spherical-harmonics degree of a surfel's own radiance with nothing left out."""


def left_out(plan: Mapping[str, Any]) -> str:
    """The effects that a plan leaves out, such as ``no rays, no lobes``.

    ``plan`` is as results store it. A field that it does not have leaves nothing out.
    """
    parts = _rays(plan)
    if not plan.get("specular", True):
        parts.append("no lobes")
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
    visibility, indirect = plan.get("visibility", True), plan.get("indirect", True)
    if not visibility and not indirect:
        return ["no rays"]
    parts = []
    if not visibility:
        parts.append("no visibility")
    if not indirect:
        parts.append("no indirect light")
    return parts


def over_seeds(texts: Mapping[int, str]) -> str:
    """Texts by seed in one text: each different text once, with its seeds if there are several."""
    seeds_by_text: dict[str, list[int]] = {}
    for seed in sorted(texts):
        seeds_by_text.setdefault(texts[seed], []).append(seed)
    if len(seeds_by_text) <= 1:
        return "".join(seeds_by_text)
    return "; ".join(
        f"{text} (seed{'s' * (len(seeds) > 1)} {', '.join(map(str, seeds))})" for text, seeds in seeds_by_text.items()
    )
