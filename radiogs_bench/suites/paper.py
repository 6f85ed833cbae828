"""Suites on generated scenes: the paper's ablations and costs, and checks of the method."""

from .baselines import IRGS, R3DG, RECOMMENDED, SVG_IR
from .experiment import FORWARD_PARITY, RELIGHTING, STABILITY
from .suite import Row, Suite, knob_rows, metrics

ABLATIONS = Suite(
    name="ablations",
    title="Ablation of radiometric consistency",
    published="ablation",
    reference="ours",
    rows=(
        Row("ours", "Ours", "Ours", {}),
        Row("no-rad", "", "λ_rad = 0", {"radiometric_weight": 0.0}),
        Row("detach-pbr", "", "Detach L_G^PBR", {"detach": "pbr"}),
        Row("detach-surfel", "", "Detach L_G", {"detach": "surfel"}),
        Row("nvs-init", "NVS init.", "NVS init.", {"initialise": "nvs"}),
    ),
    columns=metrics(
        "nvs/psnr,ssim,lpips", "normal/mae", "albedo/psnr", "roughness/mse", "relight/psnr", "indirect/psnr"
    ),
    scenes=("front_patterned", "grotto", "lamps", "crowd", "still_life", "orators"),
)
"""Scenes of six kinds on which no setting was chosen, with most indirect light first; three are by other hands."""

VIEWS = Suite(
    name="views",
    title="Scarcity of training views",
    published="views",
    reference="ours-100",
    rows=tuple(
        Row(
            f"{key}-{share}", rf"{latex}, {share}\,\%", f"{text}, {share} % of the views",
            {**variant, "view_share": share / 100},
        )
        for share in (100, 50, 25)
        for key, latex, text, variant in (
            ("ours", "Ours", "Ours", {}),
            ("no-rad", "", "λ_rad = 0", {"radiometric_weight": 0.0}),
        )
    ),
    columns=metrics("nvs/psnr", "indirect/psnr", "albedo/psnr", "relight/psnr"),
)  # fmt: skip

INIT = Suite(
    name="init",
    title="Initialisation strategies",
    published="init",
    reference="ours",
    rows=(
        Row(
            "nvs-init-no-rad", "", "NVS init., λ_rad = 0",
            {"radiometric_weight": 0.0, "initialise": "nvs"},
        ),
        Row("nvs-init", "NVS init.", "NVS init.", {"initialise": "nvs"}),
        Row("no-rad", "", "λ_rad = 0", {"radiometric_weight": 0.0}),
        Row("ours", "Ours", "Ours", {}),
    ),
    columns=metrics("nvs/psnr", "albedo/psnr", "relight/psnr", "indirect/psnr"),
)  # fmt: skip

INDIRECT = Suite(
    name="indirect",
    title="Indirect illumination",
    published="indirect",
    reference="ours",
    rows=(
        IRGS,
        R3DG,
        SVG_IR,
        Row("no-rad", "", "λ_rad = 0", {"radiometric_weight": 0.0}),
        Row("ours", "Ours", "Ours", {}),
        Row("recommended-no-rad", "", "λ_rad = 0 (recommended)",
            {"radiometric_weight": 0.0}, recipe="recommended"),
        RECOMMENDED,
    ),
    recipe="printed",
    columns=metrics("nvs/psnr,ssim,lpips", "indirect/psnr,ssim,lpips", "normal/mae", "albedo/psnr,ssim,lpips"),
)  # fmt: skip

QUALITY = metrics("nvs/psnr", "normal/mae", "albedo/psnr", "relight/psnr", "indirect/psnr")

NG = Suite(
    name="ng",
    title="Surfels that radiometric consistency samples, N_g",
    published="ng",
    reference="ng-2048",
    rows=knob_rows("ng", "N_g", "consistency_surfels", (1024, 2048, 4096, 8192)),
    columns=QUALITY,
)

NS = Suite(
    name="ns",
    title="Incident rays a surfel, N_s",
    published="ns",
    reference="ns-64",
    rows=knob_rows("ns", "N_s", "incident_samples", (16, 32, 64, 128), {"consistency_surfels": 2048}),
    recipe="printed",
    columns=(*QUALITY, *metrics("nvs/ms")),
)
"""By recipe ``printed``, as in the paper, new views and their milliseconds use the N_s directions of the row's label;
``recommended`` takes four times as many."""

STRATEGIES = Suite(
    name="strategies",
    title="How L_PBR and its incident light are computed",
    published="strategies",
    reference="ours",
    rows=(
        Row("split-sum", "Split-sum", "Split-sum", {"shading": "split-sum"}),
        Row("precomputed", "RT precompute", "RT precompute", {"incident": "precomputed"}),
        Row("no-gradient", "RT w/o diff.", "RT w/o diff.", {"incident": "detached"}),
        Row("ours", "Ours", "Ours", {}),
    ),
    columns=(*QUALITY, *metrics("nvs/ssim,lpips")),
)

RELIGHT_RAYS = 384
"""Rays per surfel in preset ``paper`` when a model is relit: 256 over the hemisphere and 128 from the light."""
TRACED = "<relight_hemisphere_samples+relight_light_samples>"


def _relit_along(rays: int) -> dict[str, float]:
    """The row's factors for shading relit frames along ``rays`` rays per surfel in preset ``paper``."""
    return dict.fromkeys(("relight_hemisphere_samples", "relight_light_samples"), rays / RELIGHT_RAYS)


RELIGHT_COST = Suite(
    name="relight-cost",
    title="Relighting: quality and milliseconds a frame",
    published="relight-cost",
    reference="split-sum",
    rows=(
        IRGS,
        R3DG,
        SVG_IR,
        *(
            Row(
                key, f"{text}, $N={TRACED}$", f"{text}, N = {TRACED} (paper: 64)", {"relighting": mode},
                _relit_along(64),
            )
            for key, text, mode in (
                ("split-sum", "PBR split-sum", "pbr"), ("pbr-finetuned", "PBR finetuned", "finetuned")
            )
        ),
        Row("surfel-finetuned", "Surfel finetuned", "Surfel finetuned", {"relighting": "surfels"}),
        *(
            Row(
                f"recommended-{key}", f"{text} (recommended)", f"{text} (recommended)", variant, recipe="recommended"
            )
            for key, text, variant in (
                ("split-sum", "PBR split-sum", {"relighting": "pbr"}),
                ("pbr-finetuned", "PBR finetuned", {"relighting": "finetuned"}),
                ("surfel-finetuned", "Surfel finetuned", {"relighting": "surfels"}),
                ("bounces", "PBR traced bounces", {"relighting": "bounces"}),
                ("path", "PBR path tracing", {"relighting": "path"}),
            )
        ),
    ),
    recipe="printed",
    columns=metrics("relight/psnr,ssim,lpips,bias,psnr_reference", "render/ms", "prepare/ms"),
    experiment=RELIGHTING,
)  # fmt: skip

EFFICIENCY = Suite(
    name="efficiency",
    title="Relighting: milliseconds and memory of a frame",
    published="efficiency",
    reference="traced-64",
    rows=(
        Row("finetuned", "Ours (Finetuned)", "Surfel finetuned", {"relighting": "surfels"}),
        *(
            Row(
                f"traced-{rays}", f"Ray tracing, $N={TRACED}$", f"Ray tracing, N = {TRACED} (paper: {rays})",
                {}, _relit_along(rays),
            )
            for rays in (64, 128, 256)
        ),
    ),
    columns=metrics("render/ms,megabytes", "relight/psnr"),
)  # fmt: skip

FORWARD_PARITY_SUITE = Suite(
    name="forward-parity",
    title="Light transport through surfels against a path tracer",
    published=None,
    reference="fine",
    rows=(
        Row(
            "fine", "3 cm", "surfels 0.03 apart", {},
            {"finetune_iterations": 1.5, "finetune_surfels": 8.0}, {"spacing": 0.03, "offset": 0.1},
        ),
        Row(
            "coarse", "6 cm", "surfels 0.06 apart", {},
            {"finetune_iterations": 1.5, "finetune_surfels": 2.0}, {"spacing": 0.06, "offset": 0.1},
        ),
        Row(
            "offset", "6 cm, offset", "0.06 apart, rays offset as in training", {},
            {"finetune_iterations": 1.5, "finetune_surfels": 2.0}, {"spacing": 0.06, "offset": 1.0},
        ),
    ),
    columns=metrics(
        *(f"{part}/{measure}" for measure in ("psnr", "bias") for part in ("total", "surfels", "direct", "indirect"))
    ),
    scenes=("corner-128", "red_white-128", "bowl-128", "furnace-0.2", "furnace-0.5", "furnace-0.8"),
    experiment=FORWARD_PARITY,
)  # fmt: skip

STABILITY_SUITE = Suite(
    name="stability",
    title="Hard cases: float32 against float64",
    published=None,
    reference=None,
    rows=tuple(
        Row(key, text, text, {}, settings={key: points})
        for key, text, points in (
            ("grazing", "Grazing angle", 25.0),
            ("aspect", "Aspect ratio", 25.0),
            ("gap", "Gap of depth", 13.0),
            ("layers", "Layers", 13.0),
            ("scale", "Scene's scale", 25.0),
            ("translation", "Translation", 25.0),
            ("roughness", "Roughness", 25.0),
            ("sun", "Sun's radiance", 25.0),
        )
    ),
    columns=metrics("forward/safe,hard,share", "gradient/safe,hard,share", "guards/fired"),
    scenes=("hard-cases",),
    experiment=STABILITY,
)
