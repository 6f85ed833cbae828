"""What a plan leaves out, as plain text."""

from collections.abc import Mapping, Sequence
from typing import Any

HIGHEST_DEGREE = 3
"""Spherical-harmonics degree of a surfel's own radiance with nothing left out."""


def left_out(plan: Mapping[str, Any]) -> str:
    """Such as ``no rays, lobes on 34 % of the surfels``.

    ``plan`` is as results store it: a mask is the share of surfels that it turns on. A field that it does not have
    counts as nothing left out.
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
