"""Methods beside each other: published ones, implemented anew on the primitives of RadioGS (docs/baselines.md)."""

from .suite import Metric, Row, Suite

OURS = Row("ours", "Ours", "RadioGS", {})
IRGS = Row("irgs", "IRGS", "IRGS (shared stage 1)", method="irgs")
"""The full method, for every table that the paper has a row of it in."""

TENSOIR_METHOD = Row("tensoir", "TensoIR", "TensoIR (own field)", method="tensoir")
"""The full method, which is no surfels, for every table that the paper has a row of it in."""

SIMILARITY = ("psnr", "ssim", "lpips")

BASELINES = Suite(
    name="baselines",
    title="Methods on the same scenes, light and metrics",
    published="tensoir",
    reference="ours",
    rows=(OURS, IRGS, TENSOIR_METHOD),
    columns=(
        *(Metric("nvs", measure) for measure in SIMILARITY),
        Metric("normal", "mae"),
        *(Metric(task, measure) for task in ("albedo", "relight") for measure in SIMILARITY),
        Metric("roughness", "mse"),
        Metric("indirect", "psnr"),
        Metric("environment", "error_scaled"),
        Metric("render", "ms"),
    ),
    scenes=("corner", "bowl", "convex", "red_white"),
)

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
        Row("constant-light", "", "constant light at the start",
            {"materials": {"start": {"light": "constant"}}}, method="irgs"),
        Row("moving", "", "geometry learnt at 1 % of its rates", {"lr_scale": 0.01}, method="irgs"),
        Row("fixed-start", "", "rays start 0.011 extents away", {"ray_start": 0.011}, method="irgs"),
        Row("one-sided", "", "surfels met from the front alone", {"two_sided": False}, method="irgs"),
        Row("samples", "", "N_s = <incident_samples>", budget={"incident_samples": 2.0}, method="irgs"),
        Row("pixels", "", "<pixels> pixels a step", budget={"pixels": 2.0}, method="irgs"),
    ),
    columns=(
        Metric("nvs", "psnr"), Metric("albedo", "psnr"), Metric("roughness", "mse"), Metric("relight", "psnr"),
        Metric("indirect", "psnr"), Metric("environment", "error_scaled"),
    ),
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
        Row("no-field-loss", "", "no marched pixels in stage 2",
            {"learning": {"inverse": {"radiance": 0.0}}}, method="tensoir"),
        Row("shaded", "", "images are shaded, not marched", {"shown": "shaded"}, method="tensoir"),
        Row("samples", "", "<secondary_samples> samples a secondary ray",
            budget={"secondary_samples": 2.0}, method="tensoir"),
        Row("directions", "", "<light_rows> rows of directions", budget={"light_rows": 2.0}, method="tensoir"),
    ),
    columns=(
        Metric("nvs", "psnr"), Metric("normal", "mae"), Metric("albedo", "psnr"), Metric("roughness", "mse"),
        Metric("relight", "psnr"), Metric("indirect", "psnr"), Metric("environment", "error_scaled"),
    ),
)  # fmt: skip

BASELINE_SUITES = (BASELINES, IRGS_ABLATIONS, TENSOIR_ABLATIONS)
