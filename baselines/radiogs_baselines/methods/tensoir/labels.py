"""What stands between a run and the published method, as labels that go with its results."""

from .field import UNITS
from .secondary import NEAR, NEAREST_SPACINGS
from .variant import PRESETS, Budget, Variant

PAPER = PRESETS["paper"]

TOLD = (
    "field_iterations", "inverse_iterations", "rays", "grid_start", "grid_end", "density_components",
    "appearance_components", "features", "hidden", "lobes", "light_rows", "secondary_samples", "relight_samples",
)  # fmt: skip
"""Fields of the budget whose difference from the paper's is a label."""


def labels_of(variant: Variant, budget: Budget) -> dict[str, str]:
    """Labels by name."""
    labels = {
        "geometry": "a field of its own, no surfels",
        "box": "the cube of what the silhouettes allow, whose other cells are empty (published: the learnt density's)",
        "nvs": _shown(variant),
        "background": "random greys in stage 2 (published: white)"
        if variant.background == "random-later"
        else "white, as published",
        "rays": f"of {budget.views} views a step (published: of all)",
    }
    reduced = {
        f"{name} {getattr(budget, name)} (published: {getattr(PAPER, name)})"
        for name in TOLD
        if getattr(budget, name) != getattr(PAPER, name)
    }
    if reduced:
        labels["reduced"] = ", ".join(sorted(reduced))
    start = NEAREST_SPACINGS * 2 / (budget.grid_end - 1)
    if start > NEAR:
        labels["ray_start"] = f"{start * UNITS:.3g} of the box's 3, for its grid is coarse (published: 0.05)"
    if budget.network_rate != PAPER.network_rate:
        labels["network_rate"] = f"{budget.network_rate:g} times the published one"
    return labels


def _shown(variant: Variant) -> str:
    if variant.shown == "field":
        return "images under the recovered light are the radiance field's, not shaded (as TensoIR reports them)"
    return "images under the recovered light are shaded (TensoIR reports the radiance field's)"
