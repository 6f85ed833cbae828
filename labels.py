"""What stands between a run and the published method, as labels that go with its results."""

from .budget import PRESETS, Budget
from .variant import Variant

PAPER = PRESETS["paper"]


def labels_of(variant: Variant, budget: Budget, extent: float) -> dict[str, str]:
    """Labels by name. ``extent``: the scene's, world units."""
    labels = {
        "geometry": f"surfels of this project in place of 3D Gaussians with a normal of their own; {_moves(variant)}",
        "stage1": "shared: novel-view synthesis of surfels in place of 3D Gaussians",
        "light_start": _light_start(variant),
        "texel_areas": f"{variant.texel_areas} in the diffuse pre-filter (published: approximate, 6 to 10 % brighter)",
        "relight_frame": "light maps with Y up, as the published code reads them" if variant.frame == "as_shipped"
        else "light maps as their files say (published: with Y up)",
    }  # fmt: skip
    return labels | (_baked(variant, budget, extent) if variant.occlusion else {}) | _reduced(budget)


def _moves(variant: Variant) -> str:
    if variant.lr_scale == 0:
        return "frozen in stage 2 (published: moved by the blending of the maps)"
    return f"moved in stage 2 at {variant.lr_scale:g} times the rates that stage 1 ends with"


def _light_start(variant: Variant) -> str:
    if variant.materials.start.light == "least-variation":
        return "shared: the light of least albedo variation (published: random between 0.25 and 0.75)"
    return "constant, by the images' exposure (published: random between 0.25 and 0.75)"


def _baked(variant: Variant, budget: Budget, extent: float) -> dict[str, str]:
    tau = "none, occluders at any distance" if variant.tau is None else f"{variant.tau * extent:.3g} world units"
    return {
        "tau": f"{tau} (published: 0.25)",
        "nearest": f"occluders from {variant.nearest * extent:.3g} world units on (published: from 0.2 on along the axis "
        "of a face, as its rasterizer draws nothing nearer)",
        "lattice": "over the cube around the surfels (published: from -1.5 to 1.5)",
        "occlusion_rays": f"{budget.occlusion_directions} traced directions (published: six faces of 256 x 256 pixels)",
    }


def _reduced(budget: Budget) -> dict[str, str]:
    reduced = {
        f"{name} {getattr(budget, name)} (published: {getattr(PAPER, name)})"
        for name in ("inverse_iterations", "occlusion_corners", "occlusion_samples", "irradiance_corners",
                     "light_height")
        if getattr(budget, name) != getattr(PAPER, name)
    }  # fmt: skip
    return {"reduced": ", ".join(sorted(reduced))} if reduced else {}
