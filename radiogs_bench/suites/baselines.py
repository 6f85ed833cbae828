"""Methods beside each other: published ones, implemented anew on the primitives of RadioGS (docs/baselines.md)."""

from .suite import Metric, Row, Suite

OURS = Row("ours", "Ours", "RadioGS", {})
TENSOIR_METHOD = Row("tensoir", "TensoIR", "TensoIR (own field)", method="tensoir")
GS_IR = Row("gs-ir", "GS-IR", "GS-IR (shared stage 1)", method="gs-ir")
GI_GS = Row("gi-gs", "GI-GS", "GI-GS (shared stage 1)", method="gi-gs")
R3DG = Row("r3dg", "R3DG", "R3DG (shared stage 1)", method="r3dg")
IRGS = Row("irgs", "IRGS", "IRGS (shared stage 1)", method="irgs")
SVG_IR = Row("svg-ir", "SVG-IR", "SVG-IR (shared stage 1)", method="svg-ir")

PUBLISHED_METHODS = (TENSOIR_METHOD, GS_IR, GI_GS, R3DG, IRGS, SVG_IR)
"""The full methods, in the order of the paper's tables, for every table that the paper has rows of them in."""

SIMILARITY = ("psnr", "ssim", "lpips")

BASELINES = Suite(
    name="baselines",
    title="Methods on the same scenes, light and metrics",
    published="tensoir",
    reference="ours",
    rows=(OURS, *PUBLISHED_METHODS),
    columns=(
        *(Metric("nvs", measure) for measure in SIMILARITY),
        Metric("normal", "mae"),
        *(Metric(task, measure) for task in ("albedo", "relight") for measure in SIMILARITY),
        Metric("roughness", "mse"),
        Metric("indirect", "psnr"),
        Metric("environment", "error_scaled"),
        Metric("render", "ms"),
        Metric("training", "megabytes"),
    ),
    scenes=("corner", "bowl", "convex", "red_white"),
)
