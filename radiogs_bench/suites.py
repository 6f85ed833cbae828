"""Suites as data: which variants of the method are run, what is measured, what stands beside it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from typing import Literal

from radiogs.errors import UsageError
from radiogs.profile import PROFILES, RELEASED
from radiogs.variant import Variant

from .cell import TRAINING


@dataclass(frozen=True)
class Measure:
    """How a kind of figure is called and printed, and which way is better."""

    label: str
    unit: str
    better: Literal["up", "down", "zero"]
    decimals: int


MEASURES: Mapping[str, Measure] = {
    "psnr": Measure("PSNR", "dB", "up", 2),
    "ssim": Measure("SSIM", "", "up", 3),
    "lpips": Measure("LPIPS", "", "down", 3),
    "mae": Measure("MAE", "deg", "down", 2),
    "mse": Measure("MSE", "", "down", 4),
    "ms": Measure("time", "ms", "down", 2),
    "bias": Measure("bias", "%", "zero", 2),
    # Stanford-ORB's own: two PSNRs, 1 - cos of normals, scale-invariant depth, distance of surfaces.
    "psnr_h": Measure("PSNR-H", "dB", "up", 2),
    "psnr_l": Measure("PSNR-L", "dB", "up", 2),
    "cosine": Measure("cosine distance", "", "down", 4),
    "simse": Measure("SI-MSE", "sq. unit", "down", 5),
    "chamfer": Measure("chamfer", "sq. unit", "down", 6),
    # The network beside a protocol's first one is named.
    "lpips_alex": Measure("LPIPS (AlexNet)", "", "down", 3),
    "lpips_vgg": Measure("LPIPS (VGG)", "", "down", 3),
    "lpips_squeeze": Measure("LPIPS (SqueezeNet)", "", "down", 3),
    # Of a recovered environment map, as it is and after the protocol's alignment.
    "error": Measure("error", "", "down", 3),
    "error_scaled": Measure("error up to scale", "", "down", 3),
}

TASKS: Mapping[str, str] = {
    "nvs": "NVS",
    "normal": "Normal",
    "albedo": "Albedo",
    "roughness": "Roughness",
    "relight": "Relight",
    "indirect": "Indirect",
    "render": "Rendering",
    "total": "Total",
    "surfels": "Surfels' own",
    "direct": "Direct",
    "depth": "Depth",
    "environment": "Light",
    "shape": "Shape",
}


@dataclass(frozen=True)
class Metric:
    """A column of a table: what is compared (``task``) and how (``measure``)."""

    task: str
    measure: str

    @property
    def key(self) -> str:
        """The name under which results store it, such as ``nvs/psnr``."""
        return f"{self.task}/{self.measure}"

    @property
    def label(self) -> str:
        """The heading, such as ``NVS PSNR``."""
        return f"{TASKS[self.task]} {MEASURES[self.measure].label}"

    @classmethod
    def of(cls, key: str) -> "Metric":
        """The inverse of ``key``."""
        task, _, measure = key.partition("/")
        return cls(task, measure)


@dataclass(frozen=True)
class Row:
    """A row of a table: a key, its label in LaTeX and in plain text, and the method variant it runs.

    ``budget`` multiplies fields of the preset, so that a row means the same share of the work under every preset.
    ``settings`` are for experiments that have some of their own.
    """

    key: str
    latex: str
    text: str
    variant: Variant
    budget: Mapping[str, float] = field(default_factory=dict)
    settings: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Suite:
    """A table: rows by columns over scenes and seeds.

    ``published`` names the published table that stands beside it, if there is one; differences and their intervals are
    paired against the row called ``reference``; ``scenes`` are what runs unless others are asked for; ``experiment`` is
    what is done for every cell (see ``experiments``).
    """

    name: str
    title: str
    published: str | None
    reference: str
    rows: tuple[Row, ...]
    columns: tuple[Metric, ...]
    scenes: tuple[str, ...] = field(default=("corner",))
    experiment: str = TRAINING

    def __post_init__(self) -> None:
        keys = [row.key for row in self.rows]
        repeated = sorted({key for key in keys if keys.count(key) > 1})
        if repeated:
            raise UsageError(f"suite '{self.name}' has rows of the same key: {', '.join(repeated)}")
        if self.reference not in keys:
            raise UsageError(
                f"suite '{self.name}' has no row '{self.reference}' to compare with", f"Its rows: {', '.join(keys)}."
            )


def _times(factor: float) -> str:
    return {0.25: r"$\frac{1}{4}$", 0.5: r"$\frac{1}{2}$"}.get(factor, f"{factor:g}")


ABLATIONS = Suite(
    name="ablations",
    title="Ablation of radiometric consistency",
    published="ablation",
    reference="ours",
    rows=(
        Row("ours", "Ours", "Ours", Variant()),
        Row("no-rad", r"$\lambda_{rad}=0$", "λ_rad = 0", Variant(radiometric_weight=0.0)),
        Row("detach-pbr", r"Detach $L_\mathbf{G}^\mathbf{PBR}$", "Detach L_G^PBR", Variant(detach="pbr")),
        Row("detach-surfel", r"Detach $L_\mathbf{G}$", "Detach L_G", Variant(detach="surfel")),
        Row("nvs-init", "NVS init.", "NVS init.", Variant(initialise="nvs")),
    ),
    columns=(
        Metric("nvs", "psnr"),
        Metric("nvs", "ssim"),
        Metric("nvs", "lpips"),
        Metric("normal", "mae"),
        Metric("albedo", "psnr"),
        Metric("roughness", "mse"),
        Metric("relight", "psnr"),
        Metric("indirect", "psnr"),
    ),
)

VIEWS = Suite(
    name="views",
    title="Scarcity of training views",
    published="views",
    reference="ours-100",
    rows=tuple(
        Row(
            f"{key}-{share}", rf"{latex}, {share}\,\%", f"{text}, {share} % of the views",
            replace(variant, view_share=share / 100),
        )
        for share in (100, 50, 25)
        for key, latex, text, variant in (
            ("ours", "Ours", "Ours", Variant()),
            ("no-rad", r"$\lambda_{rad}=0$", "λ_rad = 0", Variant(radiometric_weight=0.0)),
        )
    ),
    columns=(Metric("nvs", "psnr"), Metric("indirect", "psnr"), Metric("albedo", "psnr"), Metric("relight", "psnr")),
)  # fmt: skip

INIT = Suite(
    name="init",
    title="Initialisation strategies",
    published="init",
    reference="ours",
    rows=(
        Row(
            "nvs-init-no-rad", r"NVS init., $\lambda_{rad}=0$", "NVS init., λ_rad = 0",
            Variant(radiometric_weight=0.0, initialise="nvs"),
        ),
        Row("nvs-init", "NVS init.", "NVS init.", Variant(initialise="nvs")),
        Row("no-rad", r"$\lambda_{rad}=0$", "λ_rad = 0", Variant(radiometric_weight=0.0)),
        Row("ours", "Ours", "Ours", Variant()),
    ),
    columns=(Metric("nvs", "psnr"), Metric("albedo", "psnr"), Metric("relight", "psnr"), Metric("indirect", "psnr")),
)  # fmt: skip

INDIRECT = Suite(
    name="indirect",
    title="Indirect illumination",
    published="indirect",
    reference="ours",
    rows=(
        Row("no-rad", r"$\lambda_{rad}=0$", "λ_rad = 0", Variant(radiometric_weight=0.0)),
        Row("ours", "Ours", "Ours", Variant()),
    ),
    columns=(
        *(Metric(task, measure) for task in ("nvs", "indirect") for measure in ("psnr", "ssim", "lpips")),
        Metric("normal", "mae"),
        *(Metric("albedo", measure) for measure in ("psnr", "ssim", "lpips")),
    ),
)

QUALITY = (
    Metric("nvs", "psnr"),
    Metric("normal", "mae"),
    Metric("albedo", "psnr"),
    Metric("relight", "psnr"),
    Metric("indirect", "psnr"),
)

NG = Suite(
    name="ng",
    title="Surfels that radiometric consistency samples, N_g",
    published="ng",
    reference="ng-2048",
    rows=tuple(
        Row(
            f"ng-{paper}", rf"{_times(factor)} $N_g$", f"N_g x {factor:g} (paper: {paper})", Variant(),
            {"consistency_surfels": factor},
        )
        for paper, factor in ((1024, 0.5), (2048, 1.0), (4096, 2.0), (8192, 4.0))
    ),
    columns=QUALITY,
)  # fmt: skip

NS = Suite(
    name="ns",
    title="Incident rays a surfel, N_s",
    published="ns",
    reference="ns-64",
    rows=tuple(
        Row(
            f"ns-{paper}", rf"{_times(factor)} $N_s$", f"N_s x {factor:g} (paper: {paper})", Variant(),
            {"incident_samples": factor},
        )
        for paper, factor in ((16, 0.25), (32, 0.5), (64, 1.0), (128, 2.0))
    ),
    columns=QUALITY,
)  # fmt: skip

STRATEGIES = Suite(
    name="strategies",
    title="How L_PBR and its incident light are computed",
    published="strategies",
    reference="ours",
    rows=(
        Row("split-sum", "Split-sum", "Split-sum", Variant(shading="split-sum")),
        Row("precomputed", "RT precompute", "RT precompute", Variant(incident="precomputed")),
        Row("no-gradient", "RT w/o diff.", "RT w/o diff.", Variant(incident="detached")),
        Row("ours", "Ours", "Ours", Variant()),
    ),
    columns=(*QUALITY, Metric("nvs", "ssim"), Metric("nvs", "lpips")),
)

PROFILES_SUITE = Suite(
    name="profiles",
    title="What the released code does otherwise than the paper",
    published=None,
    reference="paper",
    rows=(
        Row("paper", "Paper", "the paper", Variant()),
        *(Row(name, name, name, Variant(deviations=(name,))) for name in RELEASED),
        Row("released", "Released", "all of them", Variant(deviations=PROFILES["released"])),
    ),
    columns=(*QUALITY, Metric("roughness", "mse")),
    scenes=("corner", "convex"),
)

RELIGHT_COST = Suite(
    name="relight-cost",
    title="Relighting: quality and milliseconds a frame",
    published="relight-cost",
    reference="split-sum",
    rows=(
        Row("split-sum", "PBR split-sum", "PBR split-sum", Variant()),
        Row("pbr-finetuned", "PBR finetuned", "PBR finetuned", Variant(relighting="finetuned")),
        Row("surfel-finetuned", "Surfel finetuned", "Surfel finetuned", Variant(relighting="surfels")),
    ),
    columns=(*(Metric("relight", measure) for measure in ("psnr", "ssim", "lpips")), Metric("render", "ms")),
)

FORWARD_PARITY = Suite(
    name="forward-parity",
    title="Light transport through surfels against a path tracer",
    published=None,
    reference="fine",
    rows=(
        Row(
            "fine", "3 cm", "surfels 0.03 apart", Variant(),
            {"finetune_iterations": 1.5, "finetune_surfels": 8.0}, {"spacing": 0.03, "offset": 0.1},
        ),
        Row(
            "coarse", "6 cm", "surfels 0.06 apart", Variant(),
            {"finetune_iterations": 1.5, "finetune_surfels": 2.0}, {"spacing": 0.06, "offset": 0.1},
        ),
        Row(
            "offset", "6 cm, offset", "0.06 apart, rays offset as in training", Variant(),
            {"finetune_iterations": 1.5, "finetune_surfels": 2.0}, {"spacing": 0.06, "offset": 1.0},
        ),
    ),
    columns=tuple(
        Metric(part, measure) for measure in ("psnr", "bias") for part in ("total", "surfels", "direct", "indirect")
    ),
    scenes=("corner-128", "red_white-128", "bowl-128", "furnace-0.2", "furnace-0.5", "furnace-0.8"),
    experiment="forward-parity",
)  # fmt: skip

SUITES: Mapping[str, Suite] = {
    suite.name: suite
    for suite in (ABLATIONS, STRATEGIES, VIEWS, INIT, INDIRECT, NG, NS, PROFILES_SUITE, RELIGHT_COST, FORWARD_PARITY)
}


def suite(name: str) -> Suite:
    """The suite of that name. Raises UsageError for an unknown one, with the nearest name."""
    if name not in SUITES:
        near = get_close_matches(name, SUITES, 1)
        raise UsageError(
            f"unknown suite '{name}'",
            f"Did you mean '{near[0]}'?" if near else f"Suites: {', '.join(SUITES)}.",
            "See them all:  radiogs-bench run --list",
        )
    return SUITES[name]
