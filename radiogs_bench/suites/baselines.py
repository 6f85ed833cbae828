"""Published methods, implemented anew on the primitives of RadioGS: their comparison, and ablations of each.

docs/baselines.md has measurements, and the meaning of each ablation.
"""

from .own import EVERY_PART
from .suite import JUDGED, Row, Suite, metrics

OURS = Row("ours", "Ours", "RadioGS", {})
RECOMMENDED = Row("recommended", "Ours (recommended)", "RadioGS (recommended)", recipe="recommended")
"""RadioGS by its recommended recipe; a comparison with published methods also has a row as printed."""
TENSOIR_METHOD = Row("tensoir", "TensoIR", "TensoIR (own field)", method="tensoir")
GS_IR = Row("gs-ir", "GS-IR", "GS-IR (shared stage 1)", method="gs-ir")
GI_GS = Row("gi-gs", "GI-GS", "GI-GS (shared stage 1)", method="gi-gs")
R3DG = Row("r3dg", "R3DG", "R3DG (shared stage 1)", method="r3dg")
IRGS = Row("irgs", "IRGS", "IRGS (shared stage 1)", method="irgs")
SVG_IR = Row("svg-ir", "SVG-IR", "SVG-IR (shared stage 1)", method="svg-ir")

PUBLISHED_METHODS = (TENSOIR_METHOD, GS_IR, GI_GS, R3DG, IRGS, SVG_IR)
"""The full methods in the order of the paper's tables, for every table that compares them."""

BASELINES = Suite(
    name="baselines",
    title="Methods on the same scenes, light and metrics",
    published="tensoir",
    reference="ours",
    rows=(OURS, RECOMMENDED, *PUBLISHED_METHODS),
    columns=metrics(
        "nvs/psnr,ssim,lpips", "normal/mae", "albedo/psnr,ssim,lpips", "relight/psnr,ssim,lpips", "roughness/mse",
        "indirect/psnr", "environment/error_scaled", "render/ms", "training/megabytes",
    ),
    scenes=JUDGED,
    recipe="printed",
)  # fmt: skip


IRGS_ABLATIONS = Suite(
    name="irgs",
    title="What IRGS is made of",
    published=None,
    reference="irgs",
    rows=(
        IRGS,
        Row("detached", "", "L_ind without gradient", {"indirect": "detached"}, method="irgs"),
        Row("no-indirect", "", "no indirect light", {"indirect": "none", "relight_indirect": False}, method="irgs"),
        Row("no-relit-indirect", "", "relit without indirect light", {"relight_indirect": False}, method="irgs"),
        Row("constant-light", "", "constant light at the start", {"materials.start.light": "constant"}, method="irgs"),
        Row("moving", "", "geometry learnt at 1 % of its rates", {"lr_scale": 0.01}, method="irgs"),
        Row("fixed-start", "", "rays start 0.011 extents away", {"ray_start": 0.011}, method="irgs"),
        Row("one-sided", "", "surfels met from the front alone", {"two_sided": False}, method="irgs"),
        Row("samples", "", "N_s = <incident_samples>", budget={"incident_samples": 2.0}, method="irgs"),
        Row("pixels", "", "<pixels> pixels a step", budget={"pixels": 2.0}, method="irgs"),
    ),
    columns=metrics(
        "nvs/psnr", "albedo/psnr", "roughness/mse", "relight/psnr", "indirect/psnr", "environment/error_scaled"
    ),
)  # fmt: skip

R3DG_ABLATIONS = Suite(
    name="r3dg",
    title="What R3DG is made of",
    published=None,
    reference="r3dg",
    rows=(
        R3DG,
        Row("gated", "", "local light times 1 - V", {"local_light": "gated"}, method="r3dg"),
        Row("no-local", "", "no local light", {"local_light": "none", "relight_local_light": False}, method="r3dg"),
        Row("no-relit-local", "", "relit without local light", {"relight_local_light": False}, method="r3dg"),
        Row("retraced", "", "V traced anew, <retraced_surfels> surfels a step", {"visibility": "retraced"},
            method="r3dg"),
        Row("composited", "", "V = 1 - A", {"hidden_below": 0.03}, method="r3dg"),
        Row("no-priors", "", "no priors on irradiance",
            {"materials": {"weights": {"irradiance_smoothness": 0.0, "light_prior": 0.0}}}, method="r3dg"),
        Row("constant-light", "", "constant light at the start", {"materials.start.light": "constant"}, method="r3dg"),
        Row("floor", "", "published heights of directions", {"floor": True}, method="r3dg"),
        Row("fixed-start", "", "rays start 0.013 extents away", {"ray_start": 0.013}, method="r3dg"),
        Row("one-sided", "", "surfels met from the front alone", {"two_sided": False}, method="r3dg"),
        Row("samples", "", "S = <incident_samples>", budget={"incident_samples": 2.0}, method="r3dg"),
    ),
    columns=IRGS_ABLATIONS.columns,
)  # fmt: skip

SVG_IR_ABLATIONS = Suite(
    name="svg-ir",
    title="What SVG-IR is made of",
    published=None,
    reference="svg-ir",
    rows=(
        SVG_IR,
        Row("no-consistency", "", "materials not fitted to kept radiance",
            {"materials": {"weights": {"consistency": 0.0}}}, method="svg-ir"),
        Row("full-length", "", "rays of full length", {"hop": None}, method="svg-ir"),
        Row("constant", "", "one material a surfel", {"attributes": "constant"}, method="svg-ir"),
        Row("fixed-ratio", "", "kept radiance counts as it is", {"materials.rates.ratio": 0.0}, method="svg-ir"),
        Row("no-indirect", "", "no indirect light", {"indirect": False, "relight_indirect": False}, method="svg-ir"),
        Row("no-relit-indirect", "", "relit without indirect light", {"relight_indirect": False}, method="svg-ir"),
        Row("constant-light", "", "constant light at the start",
            {"materials.start.light": "constant"}, method="svg-ir"),
        Row("fixed-start", "", "rays start 0.0093 extents away", {"ray_start": 0.0093}, method="svg-ir"),
        Row("sharp-light", "", "relit by the whole map", {"relight_rows": None}, method="svg-ir"),
        Row("samples", "", "S = <incident_samples>", budget={"incident_samples": 2.0}, method="svg-ir"),
    ),
    columns=IRGS_ABLATIONS.columns,
)  # fmt: skip

TENSOIR_ABLATIONS = Suite(
    name="tensoir-method",
    title="What TensoIR is made of",
    published=None,
    reference="tensoir",
    rows=(
        TENSOIR_METHOD,
        Row("no-indirect", "", "no indirect light", {"indirect": False}, method="tensoir"),
        Row("no-visibility", "", "V = 1 in training", {"visibility": False}, method="tensoir"),
        Row("no-shadow", "", "relit without shadows", {"relight_visibility": False}, method="tensoir"),
        Row("derived", "", "normals of the density", {"normals": "derived"}, method="tensoir"),
        Row("untied", "", "predicted normals not tied to the density",
            {"learning": {"inverse": {"normal_difference": 0.0}}}, method="tensoir"),
        Row("white", "", "learnt on white", {"background": "white"}, method="tensoir"),
        Row("linear", "", "linear radiance from the start", {"linear": "from-start"}, method="tensoir"),
        Row("no-field-loss", "", "no marched pixels in stage 2", {"learning.inverse.radiance": 0.0}, method="tensoir"),
        Row("shaded", "", "images are shaded, not marched", {"shown": "shaded"}, method="tensoir"),
        Row("samples", "", "<secondary_samples> samples a secondary ray",
            budget={"secondary_samples": 2.0}, method="tensoir"),
        Row("directions", "", "<light_rows> rows of directions", budget={"light_rows": 2.0}, method="tensoir"),
    ),
    columns=EVERY_PART,
)  # fmt: skip

GS_IR_ABLATIONS = Suite(
    name="gs-ir",
    title="What GS-IR is made of",
    published=None,
    reference="gs-ir",
    rows=(
        GS_IR,
        Row("no-occlusion", "", "neither occlusion nor irradiance", {"occlusion": False}, method="gs-ir"),
        Row("no-indirect", "", "no volume of irradiance", {"indirect": False}, method="gs-ir"),
        Row("endless", "", "occluders at any distance", {"tau": None}, method="gs-ir"),
        Row("near-plane", "", "no occluders within 0.044 extents", {"nearest": 0.044}, method="gs-ir"),
        Row("metallic", "", "with metalness", {"metallic": True}, method="gs-ir"),
        Row("as-shipped", "", "relit by a Y-up lookup", {"frame": "as_shipped"}, method="gs-ir"),
        Row("approximate", "", "approximate areas of texels", {"texel_areas": "approximate"}, method="gs-ir"),
        Row("frozen", "", "frozen geometry", {"lr_scale": 0.0}, method="gs-ir"),
        Row("no-prior", "", "no prior on roughness", {"materials": {"weights": {"prior": 0.0}}}, method="gs-ir"),
        Row("constant-light", "", "constant light at the start", {"materials.start.light": "constant"}, method="gs-ir"),
        Row("corners", "", "<occlusion_corners> corners an edge", budget={"occlusion_corners": 2.0}, method="gs-ir"),
    ),
    columns=(*IRGS_ABLATIONS.columns, *metrics("normal/mae")),
)  # fmt: skip

GI_GS_ABLATIONS = Suite(
    name="gi-gs",
    title="What GI-GS is made of",
    published=None,
    reference="gi-gs",
    rows=(
        GI_GS,
        Row("no-indirect", "", "no indirect light", {"indirect": False, "relight_indirect": False}, method="gi-gs"),
        Row("no-relit-indirect", "", "relit without indirect light", {"relight_indirect": False}, method="gi-gs"),
        Row("no-occlusion", "", "no occlusion", {"occlusion": False}, method="gi-gs"),
        Row("neither", "", "split sum alone",
            {"indirect": False, "relight_indirect": False, "occlusion": False}, method="gi-gs"),
        Row("linear", "", "lights added up as linear radiance", {"sum": "linear"}, method="gi-gs"),
        Row("as-shipped", "", "relit by maps read with Y up", {"frame": "as_shipped"}, method="gi-gs"),
        Row("readme-bug", "", "trained as its README says", {"readme_bug": True}, method="gi-gs"),
        Row("near", "", "marches begin at the first step", {"start": 1}, method="gi-gs"),
        Row("metallic", "", "metal learnt", {"metallic": True}, method="gi-gs"),
        Row("still", "", "geometry frozen in stage 2", {"lr_scale": 0.0}, method="gi-gs"),
        Row("constant-light", "", "constant light at the start", {"materials.start.light": "constant"}, method="gi-gs"),
        Row("azimuths", "", "<azimuths> azimuths", budget={"azimuths": 2.0}, method="gi-gs"),
        Row("shown", "", "<render_azimuths> azimuths shown", budget={"render_azimuths": 2.0}, method="gi-gs"),
    ),
    columns=IRGS_ABLATIONS.columns,
)  # fmt: skip

BASELINE_ABLATIONS = (
    GS_IR_ABLATIONS, GI_GS_ABLATIONS, R3DG_ABLATIONS, IRGS_ABLATIONS, SVG_IR_ABLATIONS, TENSOIR_ABLATIONS,
)  # fmt: skip
