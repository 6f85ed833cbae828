"""What stands between a run and the published method, as labels that go with its results."""

from .variant import PRESETS, Budget, Variant

PAPER = PRESETS["paper"]


def labels_of(variant: Variant, budget: Budget, extent: float) -> dict[str, str]:
    """Labels by name. ``extent``: the scene's, world units."""
    labels = {
        "geometry": "surfels of this project in place of flattened 3D Gaussians; no monocular normals",
        "stage1": "shared: novel-view synthesis in place of SVG-IR's own",
        "light_start": _light_start(variant),
        "hop": _hop(variant, extent),
        "ray_start": _ray_start(variant, extent),
        "attributes": f"vertices {variant.vertex_distance:g} standard deviations from the axes (published: by the size "
        "of the splat in the image)",
    }
    if variant.attributes == "constant":
        labels["attributes"] = "constant-attribute: one material a surfel in place of four vertices"
    lowered = {
        f"{name} {getattr(budget, name)} (published: {getattr(PAPER, name)})"
        for name in ("inverse_iterations", "incident_samples", "relight_samples")
        if getattr(budget, name) != getattr(PAPER, name)
    }
    if budget.consistency_surfels < budget.maximum_surfels:
        lowered.add(f"consistency_surfels {budget.consistency_surfels} (published: all)")
    if lowered:
        labels["reduced"] = ", ".join(sorted(lowered))
    return labels


def _light_start(variant: Variant) -> str:
    if variant.materials.start.light == "least-variation":
        return "shared: the light of least albedo variation (published: constant)"
    return "constant, by the images' exposure"


def _hop(variant: Variant, extent: float) -> str:
    if variant.hop is None:
        return "rays of full length (published: 0.2 from hit to hit)"
    return f"{variant.hop * extent:.3g} world units (published: 0.2)"


def _ray_start(variant: Variant, extent: float) -> str:
    if variant.ray_start is None:
        return "one standard deviation of the surfel that a ray leaves (published: 0.042)"
    return f"{variant.ray_start * extent:.3g} world units (published: 0.042)"
