"""Methods beside each other: published ones, implemented anew on the primitives of RadioGS (docs/baselines.md)."""

from .suite import Metric, Row, Suite

OURS = Row("ours", "Ours", "RadioGS", {})
IRGS = Row("irgs", "IRGS", "IRGS (shared stage 1)", method="irgs")
"""The full method, for every table that the paper has a row of it in."""
R3DG = Row("r3dg", "R3DG", "R3DG (shared stage 1)", method="r3dg")
"""The full method, for every table that the paper has a row of it in."""

SIMILARITY = ("psnr", "ssim", "lpips")

BASELINES = Suite(
    name="baselines",
    title="Methods on the same geometry, tracer, light and metrics",
    published="tensoir",
    reference="ours",
    rows=(OURS, IRGS, R3DG),
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
        Row("constant-light", "", "constant light at the start",
            {"materials": {"start": {"light": "constant"}}}, method="r3dg"),
        Row("floor", "", "published heights of directions", {"floor": True}, method="r3dg"),
        Row("fixed-start", "", "rays start 0.013 extents away", {"ray_start": 0.013}, method="r3dg"),
        Row("one-sided", "", "surfels met from the front alone", {"two_sided": False}, method="r3dg"),
        Row("samples", "", "S = <incident_samples>", budget={"incident_samples": 2.0}, method="r3dg"),
    ),
    columns=IRGS_ABLATIONS.columns,
)  # fmt: skip

BASELINE_SUITES = (BASELINES, IRGS_ABLATIONS, R3DG_ABLATIONS)
