"""What stands between a run and the published method, as labels that go with its results."""

from .variant import PRESETS, Budget, Variant

PAPER = PRESETS["paper"]

PUBLISHED_LENGTHS = {"radius": 0.8, "bias": 0.01, "thick": 0.05, "far": 100.0}
"""In the world units of TensoIR's scenes."""


def labels_of(variant: Variant, budget: Budget, extent: float) -> dict[str, str]:
    """Labels by name. ``extent``: the scene's, world units."""
    lengths = (
        f"{name} {extent * getattr(variant, name):.3g} (published: {value:g})"
        for name, value in PUBLISHED_LENGTHS.items()
    )
    labels = {
        "geometry": f"surfels of this project in place of 3D Gaussians with a normal of their own; {_moves(variant)}",
        "stage1": "shared: novel-view synthesis of surfels in place of 3D Gaussians",
        "light_start": _light_start(variant),
        "lengths": f"shares of the extent, here {', '.join(lengths)}",
        "start": _start(variant),
        "relight_frame": "light maps with Y up, as the published code reads them" if variant.frame == "as_shipped"
        else "light maps as their files say (published: with Y up)",
    }  # fmt: skip
    reduced = {
        f"{name} {getattr(budget, name)} (published: {getattr(PAPER, name)})"
        for name in ("inverse_iterations", "azimuths", "heights", "march_steps", "light_height", "render_azimuths",
                     "render_heights")
        if getattr(budget, name) != getattr(PAPER, name)
    }  # fmt: skip
    return labels | ({"reduced": ", ".join(sorted(reduced))} if reduced else {})


def _moves(variant: Variant) -> str:
    if variant.lr_scale == 0:
        return "frozen in stage 2 (published: moved by the blending of the maps)"
    return f"moved in stage 2 at {variant.lr_scale:g} times the rates that stage 1 ends with"


def _light_start(variant: Variant) -> str:
    if variant.materials.start.light == "least-variation":
        return "shared: the light of least albedo variation (published: random between 0.25 and 0.75)"
    return "constant, by the images' exposure (published: random between 0.25 and 0.75)"


def _start(variant: Variant) -> str:
    shown = f"marches begin at {variant.start} of 16 steps"
    if variant.readme_bug:
        return f"{shown} where images are shown, at {variant.training_start} in training, as the README's command says"
    return f"{shown} (published: 8; its README's command trains with 64, which finds nothing)"
