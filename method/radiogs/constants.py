"""Every constant of the paper's text and of the published code, with its value in the three recipes."""

from dataclasses import dataclass
from typing import Any

from radiogs_core.plain_values import value_at, with_values

from .recipes import OF_SCRIPTS, RECIPES
from .settings import PRESETS, Variant


@dataclass(frozen=True)
class Constant:
    """A constant, or a formula, of the paper or of the published code."""

    topic: str
    """The part of the method that it belongs to."""
    name: str
    """Name in words."""
    field: str
    """Dotted name of the field of ``Variant``, of the budget of preset "paper" as ``budget.NAME``, or of a deviation as
    ``deviations.NAME``; empty for one that no recipe reproduces."""
    paper: Any = None
    """The paper's value, in the field's unit; None if the paper does not state one."""
    code: Any = None
    """The published code's value, in the field's unit; None if equal to ``paper``."""
    remark: str = ""
    """Source, unit, slip that was mended, or the reason why it is not reproduced and the size of the difference."""


LOSSES, RATES, SCHEDULE, DENSITY, START, LIGHT, RAYS, RELIGHTING = (
    "losses", "learning rates", "schedule", "density control", "start", "light and BRDF", "rays", "relighting",
)  # fmt: skip

CONSTANTS: tuple[Constant, ...] = (
    Constant(SCHEDULE, "steps of stage 1", "budget.geometry.steps", 40_000, remark="training details"),
    Constant(SCHEDULE, "steps of stage 2", "budget.inverse_iterations", 20_000, remark="training details"),
    Constant(SCHEDULE, "steps of fine-tuning", "budget.finetune_iterations", 2_000, remark="about 2 minutes"),
    Constant(SCHEDULE, "surfels in L_rad, N_g", "budget.consistency_surfels", 4096,
             remark="the text's; its tables and the published code have 2048, and suite ng runs both: 0.01 dB apart in"
             " the paper"),
    Constant(SCHEDULE, "rays of a surfel, N_s", "budget.incident_samples", 64),
    Constant(SCHEDULE, "steps between two tracings of all light", "budget.refresh_interval", None, 100),
    Constant(SCHEDULE, "share of stage 1 from which L_rad counts", "split_sum.consistency_from", None, 2_000 / 40_000),
    Constant(SCHEDULE, "share of stage 1 from which distortion counts", "geometry.schedule.distortion_from", None,
             3_000 / 40_000),
    Constant(SCHEDULE, "shares of stage 1 from which degrees 1, 2, 3 are learnt", "geometry.schedule.degrees_from",
             None, (6_000 / 40_000, 7_000 / 40_000, 8_000 / 40_000)),
    Constant(SCHEDULE, "share of stage 2 from which normals count", "materials.normal_from", 0.0, 1_000 / 20_000,
             "the paper's L_inv has all terms of L_init from the start"),
    Constant(SCHEDULE, "share of rates that is left at the end of stage 1", "geometry.rates.end_share", 1.0,
             remark="2DGS: constant but for positions"),
    Constant(LOSSES, "L1 in L_recon", "geometry.weights.absolute", 0.8, remark="appendix, reconstruction loss"),
    Constant(LOSSES, "1 - SSIM in L_recon", "geometry.weights.similarity", 0.2),
    Constant(LOSSES, "L1 of the surfels' image, stage 2", "materials.weights.absolute", 0.8),
    Constant(LOSSES, "L1 of 1.0 in L_recon^PBR, stage 2", "deviations.image-weight", False, True),
    Constant(LOSSES, "1 - SSIM, stage 2", "materials.weights.similarity", 0.2),
    Constant(LOSSES, "squared error of L_recon^PBR, stage 2", "materials.weights.squared", 0.0),
    Constant(LOSSES, "L_recon^PBR of stage 1", "split_sum.image", 1.0),
    Constant(LOSSES, "image of the surfels' own radiance in stage 1", "geometry.weights.radiance", 1.0,
             remark="the published scripts of three scenes leave it and L_rad out of stage 1"),
    Constant(LOSSES, "losses of the split sum reach the surfels' shape", "split_sum.geometry_gradient", True),
    Constant(LOSSES, "lambda_rad, stage 1", "split_sum.consistency", 0.2, 0.1),
    Constant(LOSSES, "lambda_rad, stage 2", "radiometric_weight", 0.2),
    Constant(LOSSES, "L_rad has no gradient to the light", "deviations.light-detached", False, True),
    Constant(LOSSES, "L_rad has gradient to roughness", "materials.consistent_roughness", True),
    Constant(LOSSES, "lambda_n, stage 1", "geometry.weights.normal", 0.05),
    Constant(LOSSES, "lambda_n, later in stage 1", "geometry.weights.normal_late", 0.05),
    Constant(LOSSES, "lambda_n, stage 2", "materials.weights.normal", 0.05),
    Constant(LOSSES, "lambda_d, stage 1", "geometry.weights.distortion", 2.0,
             remark="1000 on 2DGS's projected depth m(z), in this field's unit"),
    Constant(LOSSES, "lambda_d, stage 2", "materials.weights.distortion", 2.0, 0.0),
    Constant(LOSSES, "lambda_ns, stage 1", "geometry.weights.normal_smoothness", 0.02),
    Constant(LOSSES, "share of stage 1 until which lambda_ns counts", "geometry.schedule.normal_smoothness_until", 1.0,
             18_000 / 40_000),
    Constant(LOSSES, "lambda_ns, stage 2", "materials.weights.normal_smoothness", 0.02, 0.01),
    Constant(LOSSES, "lambda_m, stage 1", "geometry.weights.mask", 0.05, 0.02,
             "the paper's lambda_s: its sparsity loss is unbounded below as printed, and the mask's cross-entropy is"
             " in its place; published code: 0.05 for Synthetic4Relight and Stanford-ORB"),
    Constant(LOSSES, "lambda_m, stage 2", "materials.weights.mask", 0.05, 0.02,
             "published code: 0.01 for Synthetic4Relight and Stanford-ORB"),
    Constant(LOSSES, "lambda_as", "materials.weights.albedo_smoothness", 0.2, remark="Synthetic4Relight's scripts: 1"),
    Constant(LOSSES, "lambda_rs", "materials.weights.roughness_smoothness", 0.1,
             remark="Synthetic4Relight's scripts: 0.5"),
    Constant(LOSSES, "smoothness falls at edges by exp(-s |gradient|), s", "geometry.edge_sharpness", 1.0),
    Constant(LOSSES, "smoothness across silhouettes", "geometry.across_silhouettes", True),
    Constant(LOSSES, "lambda_light", "materials.weights.light_prior", 0.01,
             remark="scripts of lego and Synthetic4Relight: 0.1"),
    Constant(LOSSES, "smoothness of the light", "materials.weights.light_smoothness", 0.0, 0.02,
             "published code: total variation of the displayed map; here of its logarithm"),
    Constant(LOSSES, "normals of the depth map", "geometry.normal_target", "central", remark="2DGS"),
    Constant(RATES, "albedo, stage 1", "split_sum.albedo_rate", 0.005, 0.0075),
    Constant(RATES, "roughness, stage 1", "split_sum.roughness_rate", 0.005),
    Constant(RATES, "light, stage 1", "split_sum.light_rate", 0.01),
    Constant(RATES, "albedo, stage 2", "materials.rates.albedo", 0.005, 0.0075),
    Constant(RATES, "roughness, stage 2", "materials.rates.roughness", 0.005),
    Constant(RATES, "light, stage 2", "materials.rates.constant_light", 0.01, 0.005,
             "of a light that starts constant"),
    Constant(RATES, "harmonics of degree 0, stage 1", "geometry.rates.radiance", 0.0025, 0.0075, "2DGS"),
    Constant(RATES, "harmonics of higher degrees, stage 1", "geometry.rates.radiance_rest", 0.0025 / 20, 0.0075 / 20,
             "2DGS"),
    Constant(RATES, "harmonics of degree 0, stage 2", "materials.rates.radiance", 0.0025, 0.0075, "2DGS"),
    Constant(RATES, "harmonics of higher degrees, stage 2", "materials.rates.radiance_rest", 0.0025 / 20, 0.0075 / 20,
             "2DGS"),
    Constant(RATES, "positions at the start, extents", "geometry.rates.position", 1.6e-4, remark="2DGS"),
    Constant(RATES, "positions at the end, extents", "geometry.rates.position_end", 1.6e-6,
             remark="2DGS; an addition inside the published logarithm leaves 1.7e-5 world units at the end"),
    Constant(RATES, "rotations", "geometry.rates.rotation", 0.001, remark="2DGS"),
    Constant(RATES, "scales", "geometry.rates.scale", 0.005, remark="2DGS"),
    Constant(RATES, "opacities", "geometry.rates.opacity", 0.05, remark="2DGS"),
    Constant(RATES, "power of the length rule", "materials.rates.length_power", None, None,
             "rates of stage 2 in a stage of n steps: times (20,000 / n) to this power, at most 12; 1 at 20,000"),
    Constant(RATES, "power of the length rule for roughness", "materials.rates.roughness_length_power", None, None),
    Constant(RATES, "factor for geometry in stage 2", "materials.rates.geometry", None, 0.01,
             "Synthetic4Relight's scripts: 0.001, air_baloons 0"),
    Constant(DENSITY, "share of stage 1 where it begins", "geometry.density.start", 500 / 40_000, remark="2DGS"),
    Constant(DENSITY, "share of stage 1 where it ends", "geometry.density.end", 15_000 / 40_000, 25_000 / 40_000,
             "2DGS: after 15,000 steps"),
    Constant(DENSITY, "threshold of the positional gradient", "geometry.density.gradient_threshold", 2e-4,
             remark="2DGS"),
    Constant(DENSITY, "opacity below which surfels are pruned", "geometry.density.opacity_floor", 0.05, remark="2DGS"),
    Constant(DENSITY, "share of stage 1 between two resets to 0.01", "geometry.density.resets.lower_every",
             3_000 / 40_000, remark="2DGS; in a short stage no more often than every 400 steps"),
    Constant(DENSITY, "share of stage 1 between two resets to 0.9", "geometry.density.resets.raise_every", 0.0,
             1_000 / 40_000, "the published code then holds opacities for 200 steps; here it does not"),
    Constant(DENSITY, "surfels that hardly show are pruned at", "geometry.density.hidden_at", ()),
    Constant(DENSITY, "surfels that no view has seen are pruned", "geometry.density.prune_unseen", False),
    Constant(START, "points", "geometry.start.points", None, "box",
             "2DGS: random in a cube. With 6,000 of them, as at preset tiny, stage 1 reaches 27.2 dB of new views on"
             " corner, and 34.0 with points of the silhouettes' hull, which printed has; here facing the cameras"),
    Constant(START, "opacity", "geometry.start.opacity", None, 0.1),
    Constant(START, "background of stage 1", "geometry.backgrounds", None, (1.0,)),
    Constant(START, "roughness, stage 1", "geometry.start.roughness", None, 0.1),
    Constant(START, "radiance of the light, stage 1", "split_sum.light", None, 0.5),
    Constant(START, "albedo, stage 2", "materials.start.albedo", None, 0.3,
             "the published code's inverse is wrong, so its albedo starts at 0.196"),
    Constant(START, "roughness, stage 2", "materials.start.roughness", None, 0.6, "scripts of lego and jugs: 0.8"),
    Constant(START, "light, stage 2", "materials.start.light", None, "constant"),
    Constant(START, "light of radiance 1.5, stage 2", "deviations.start-light", None, True),
    Constant(START, "stage 1 learns display colour, stage 2 reads it as linear", "deviations.display-radiance", False,
             True, "L_G is a radiance in the paper"),
    Constant(START, "sRGB of coverage times radiance", "deviations.premultiplied-encoding", False, True,
             "in the published code's stage 1 colours are display colours, so that only its stage 2 encodes so"),
    Constant(LIGHT, "masking of the pre-integrated BRDF", "masking", None, "height-correlated",
             "nvdiffrec's table; the published code reads the first surfel's entry for all surfels, here each its own"),
    Constant(RAYS, "share of N_s drawn from the light", "materials.directions.from_light", 0.0),
    Constant(RAYS, "sets of N_s with an image each", "materials.directions.sets", 1),
    Constant(RAYS, "directions end 10 degrees above the horizon", "deviations.hemisphere-floor", False, True,
             "the paper: uniform over the hemisphere"),
    Constant(RAYS, "rays start at a fixed distance", "deviations.fixed-offset", None, True),
    Constant(RAYS, "that distance, world units", "ray_offset", None, 0.05, "0.1 in the scripts of four scenes"),
    Constant(RAYS, "rays meet surfels from the front alone", "deviations.one-sided-rays", None, True),
    Constant(RAYS, "new views along N_s directions", "deviations.spread-views", True),
    Constant(RELIGHTING, "mode", "relighting", "pbr"),
    Constant(RELIGHTING, "light on what relit rays meet", "met_light", "unoccluded"),
    Constant(RELIGHTING, "rays over the hemisphere", "budget.relight_hemisphere_samples", 256),
    Constant(RELIGHTING, "rays from the light", "budget.relight_light_samples", 128),
    Constant(RELIGHTING, "fine-tuning: rate of degree 0", "finetuning.degree_0", 0.0025, 0.0075,
             "\"the same learning rate\": 2DGS's; the published code's comes from its old optimiser"),
    Constant(RELIGHTING, "fine-tuning: unit of the rate", "finetuning.unit", "one"),
    Constant(RELIGHTING, "fine-tuning: share of the rate at the end", "finetuning.last_share", 1.0),
    Constant(LIGHT, "parametrisation of the light", "", "cube map of 32", "latitude-longitude, 64 x 128",
             "latitude-longitude, logarithmic, in every recipe: 8,192 texels at preset paper beside 6,144 of the cube"
             " map; smaller than a step of N_s = 64 directions resolves"),
    Constant(LOSSES, "form of the distortion", "", "|z_i - z_j|", "squares of m(z)",
             "squares of z over the camera's distance, as 2DGS's code has squares"),
    Constant(LOSSES, "depth of the normals", "", "median", "expected depth",
             "expected depth: the rasterizer has no median, and the published code's slot for it holds another sum"),
    Constant(LOSSES, "norm of the residual of L_rad", "", "l1", "mean over channels",
             "mean over channels, as in the published code: a third of the sum"),
    Constant(LOSSES, "light prior", "", "per-channel averages of the light", "mean over a surfel's directions",
             "irradiance of each surfel's normal"),
    Constant(LOSSES, "images brighter than a saturated pixel", "", None, "no gradient above 1",
             "no error where the target is saturated, an error elsewhere"),
    Constant(LOSSES, "gradient of L_PBR to positions by the view's direction", "", "yes", "yes",
             "none: directions are constants of a step, whose change is a position's step over its distance"),
    Constant(DENSITY, "surfels above 20 pixels on the screen are pruned", "", "2DGS", "after 3,000 steps",
             "not pruned: 20 of 800 pixels would be 2 of 96, and most surfels of a small run"),
    Constant(RAYS, "smallest footprint of a surfel", "", "0.7 pixels (2DGS)", "0.7 pixels (2DGS)",
             "the pixel's variance, stretched in the surfel's plane"),
    Constant(RAYS, "what a ray meets", "", "two triangles", "icosahedra of 20 triangles",
             "the exact ellipse of opacity 1/255"),
    Constant(LIGHT, "smallest roughness", "", None, "none", "0.05: below it a lobe is narrower than N_s directions"),
)  # fmt: skip
"""All constants, topic by topic."""


def value_in(constant: Constant, recipe: str) -> Any:
    """The value of a constant's field by a recipe, at preset "paper"."""
    if constant.field.startswith("budget."):
        return value_at(PRESETS["paper"], constant.field.removeprefix("budget."))
    variant = with_values(Variant(), RECIPES[recipe].values)
    if constant.field.startswith("deviations."):
        return constant.field.removeprefix("deviations.") in variant.deviations
    return value_at(variant, constant.field)


def recipe_table() -> str:
    """All constants with their values, as Markdown: a table a topic, one of scenes, and what no recipe reproduces."""
    sources = ["", "the paper", "its code"]
    tables = []
    for topic in dict.fromkeys(each.topic for each in CONSTANTS):
        rows = [
            [*_sources(each), *(as_text(value_in(each, recipe)) for recipe in RECIPES), f"`{each.field}`", each.remark]
            for each in CONSTANTS
            if each.topic == topic and each.field
        ]
        tables.append(_table(f"{topic[0].upper()}{topic[1:]}", [*sources, *RECIPES, "field", "remark"], rows))
    rows = [
        [f"{layout}, {scene or 'all scenes'}", ", ".join(f"`{name}` {as_text(each)}" for name, each in values.items())]
        for (layout, scene), values in OF_SCRIPTS.items()
    ]
    tables.append(_table("Values of `released` for single scenes", ["scene", "values"], rows))
    rows = [[*_sources(each), each.remark] for each in CONSTANTS if not each.field]
    tables.append(_table("Not reproduced", [*sources, "here, in every recipe, and why"], rows))
    return "\n\n".join(tables) + "\n"


def _sources(constant: Constant) -> tuple[str, str, str]:
    """Name, and the values of the paper and of its code."""
    paper, code = ("-" if each is None else as_text(each) for each in (constant.paper, constant.code))
    return constant.name, paper, paper if constant.code is None else code


def _table(title: str, head: list[str], rows: list[list[str]]) -> str:
    lines = [
        f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"
        for cells in (head, ["---"] * len(head), *rows)
    ]
    return "\n".join([f"## {title}", "", *lines])


def as_text(value: Any) -> str:
    """A value of a field in words, for tables and labels.

    >>> [as_text(each) for each in (True, 40_000, 0.05, (1.0, 0.0), ())]
    ['yes', '40,000', '0.05', '[1, 0]', 'none']
    """
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple):
        return f"[{', '.join(map(as_text, value))}]" if value else "none"
    return f"{value:,}" if type(value) is int else f"{value:g}" if isinstance(value, float) else str(value)
