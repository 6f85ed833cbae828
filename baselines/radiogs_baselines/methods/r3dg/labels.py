"""What stands between a run and the published method, as labels that go with its results."""

from .variant import PRESETS, Budget, Variant

PAPER = PRESETS["paper"]


def labels_of(variant: Variant, budget: Budget, extent: float) -> dict[str, str]:
    """Labels by name. ``extent``: the scene's, world units."""
    labels = {
        "geometry": "surfels of this project in place of 3D Gaussians with a normal of their own",
        "stage1": "shared: novel-view synthesis of surfels in place of 3D Gaussians",
        "light_start": _light_start(variant),
        "ray_start": _ray_start(variant, extent),
        "directions": _directions(variant),
    }
    reduced = {
        f"{name} {getattr(budget, name)} (published: {getattr(PAPER, name)})"
        for name in ("inverse_iterations", "incident_samples", "relight_samples", "light_height")
        if getattr(budget, name) != getattr(PAPER, name)
    }
    if reduced:
        labels["reduced"] = ", ".join(sorted(reduced))
    if budget.local_rate != PAPER.local_rate:
        labels["local_rate"] = f"{budget.local_rate:g} times the published rates of the local light"
    return labels


def _light_start(variant: Variant) -> str:
    if variant.materials.start.light == "least-variation":
        return "shared: the light of least albedo variation (published: random between 0.69 and 0.97)"
    return "constant, by the images' exposure (published: random between 0.69 and 0.97)"


def _ray_start(variant: Variant, extent: float) -> str:
    if variant.ray_start is None:
        return "one standard deviation of the surfel (published: 0.06)"
    return f"{variant.ray_start * extent:.3g} world units (published: 0.06)"


def _directions(variant: Variant) -> str:
    return "none below 10 degrees, as published" if variant.floor else "down to the horizon (published: to 10 degrees)"
