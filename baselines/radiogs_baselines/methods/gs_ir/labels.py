"""What stands between a run and the published method, as labels that go with its results."""

from .variant import PRESETS, Budget, Variant

PAPER = PRESETS["paper"]


def labels_of(variant: Variant, budget: Budget, extent: float) -> dict[str, str]:
    """Labels by name. ``extent``: the scene's, world units."""
    labels = {
        "geometry": "surfels of this project and their normals in place of 3D Gaussians with a normal of their own",
        "stage1": "shared: novel-view synthesis of surfels in place of 3D Gaussians",
        "light_start": _light_start(variant),
        "light": "a lat-long map of log-radiance (published: a cube map of radiance, not below zero)",
        "texel_areas": f"{variant.texel_areas} in the diffuse pre-filter (published: approximate, 8 % brighter)",
        "relight_frame": _frame(variant),
        "roughness": "from 0.05, in training and shown (published: from 0.04 in training, from 0 shown)",
        "encoding": "images are encoded for display (published: an option, --gamma)",
    }
    if variant.occlusion:
        labels |= {
            "tau": _tau(variant, extent),
            "nearest": _nearest(variant, extent),
            "probes": "where a surfel is within one standard deviation (published: in the cells of Gaussians' centres)",
            "box": "the cube around the surfels (published: [-1.5, 1.5]^3)",
            "occlusion_rays": f"{budget.occlusion_directions} traced directions (published: six faces of 256 x 256)",
        }
    return labels | _reduced(budget) | _geometry_rate(variant)


def _reduced(budget: Budget) -> dict[str, str]:
    reduced = {
        f"{name} {getattr(budget, name)} (published: {getattr(PAPER, name)})"
        for name in ("inverse_iterations", "occlusion_corners", "occlusion_samples", "irradiance_corners")
        if getattr(budget, name) != getattr(PAPER, name)
    }
    return {"reduced": ", ".join(sorted(reduced))} if reduced else {}


def _geometry_rate(variant: Variant) -> dict[str, str]:
    if variant.lr_scale == 1:
        return {}
    return {"lr_scale": f"{variant.lr_scale:g} of the rates that stage 1 ends with (published: 1)"}


def _light_start(variant: Variant) -> str:
    if variant.materials.start.light == "least-variation":
        return "shared: the light of least albedo variation (published: random between 0.25 and 0.75)"
    return "constant, by the images' exposure (published: random between 0.25 and 0.75)"


def _frame(variant: Variant) -> str:
    if variant.frame == "as_shipped":
        return "Y-up lookup of new lights along Z-up directions, as published"
    return "new lights as their maps are meant (published: a Y-up lookup along Z-up directions)"


def _tau(variant: Variant, extent: float) -> str:
    if variant.tau is None:
        return "none: occluders at any distance (published: 0.25)"
    return f"{variant.tau * extent:.3g} world units (published: 0.25)"


def _nearest(variant: Variant, extent: float) -> str:
    published = "(published: Gaussians nearer than 0.2 along a face's axis are not drawn)"
    if variant.nearest == 0:
        return f"occluders at any distance below tau {published}"
    return f"occluders from {variant.nearest * extent:.3g} world units on {published}"
