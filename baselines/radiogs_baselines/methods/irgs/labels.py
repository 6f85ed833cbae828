"""What stands between a run and the published method, as labels that go with its results."""

from .variant import PRESETS, Budget, Variant

PAPER = PRESETS["paper"]


def labels_of(variant: Variant, budget: Budget, extent: float) -> dict[str, str]:
    """Labels by name. ``extent``: the scene's, world units."""
    labels = {
        "geometry": "surfels of this project, traced and rasterised by its kernels",
        "stage1": "shared: novel-view synthesis in place of Ref-Gaussian",
        "light_start": _light_start(variant),
        "ray_start": _ray_start(variant, extent),
        "fresnel": "F0 0.04 at what relit rays meet, too (published: 0.02)",
    }
    reduced = {
        f"{name} {getattr(budget, name)} (published: {getattr(PAPER, name)})"
        for name in ("inverse_iterations", "pixels", "incident_samples", "relight_hemisphere_samples",
                     "relight_light_samples", "render_samples")
        if getattr(budget, name) != getattr(PAPER, name)
    }  # fmt: skip
    if reduced:
        labels["reduced"] = ", ".join(sorted(reduced))
    if variant.lr_scale > 0:
        labels["lr_scale"] = f"{variant.lr_scale:g} (published scripts: 0)"
    return labels


def _light_start(variant: Variant) -> str:
    if variant.materials.start.light == "least-variation":
        return "shared: the light of least albedo variation (published: a constant 1.5)"
    return "constant, by the images' exposure (published: a constant 1.5)"


def _ray_start(variant: Variant, extent: float) -> str:
    if variant.ray_start is None:
        return "one standard deviation of the surfels that a pixel sees (published: 0.05)"
    return f"{variant.ray_start * extent:.3g} world units (published: 0.05)"
