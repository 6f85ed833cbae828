"""What a plan leaves out, in words."""

from collections.abc import Mapping, Sequence
from typing import Any

HIGHEST_DEGREE = 3


def left_out(plan: Mapping[str, Any]) -> str:
    """Such as: no rays; lobes on 34 % of the surfels. ``plan`` is as results keep it: of masks the share that is on."""
    parts = [*_rays(plan), *_lobes(plan)]
    if not plan["bounces"]:
        parts.append("one bounce")
    if not plan["light_sampling"]:
        parts.append("nothing drawn from the light")
    if plan["sh_degree"] < HIGHEST_DEGREE:
        parts.append(f"own radiance of degree {plan['sh_degree']}")
    if plan["samples"] > 1:
        parts.append(f"1/{plan['samples']} of the directions")
    if plan["refresh"] > 1:
        parts.append(f"all traced anew 1/{plan['refresh']} as often")
    return ", ".join(parts) or "nothing"


def _rays(plan: Mapping[str, Any]) -> list[str]:
    if not plan["visibility"] and not plan["indirect"]:
        return ["no rays"]
    parts = [] if plan["traced"] is None else [f"rays from {100 * plan['traced']:.0f} % of the surfels"]
    if not plan["visibility"]:
        parts.append("no visibility")
    if not plan["indirect"]:
        parts.append("no indirect light")
    return parts


def _lobes(plan: Mapping[str, Any]) -> list[str]:
    if not plan["specular"]:
        return ["no lobes"]
    return [] if plan["specular_at"] is None else [f"lobes on {100 * plan['specular_at']:.0f} % of the surfels"]


def over_seeds(texts: Mapping[int, str]) -> str:
    """Texts by seed as one: what is the same in all is said once, the rest with its seeds."""
    said: dict[str, list[int]] = {}
    for seed in sorted(texts):
        said.setdefault(texts[seed], []).append(seed)
    if len(said) <= 1:
        return "".join(said)
    return "; ".join(f"{text} ({_seeds(seeds)})" for text, seeds in said.items())


def _seeds(seeds: Sequence[int]) -> str:
    return f"seed{'' if len(seeds) == 1 else 's'} {', '.join(map(str, seeds))}"
