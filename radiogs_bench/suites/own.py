"""Suites without a table in the paper: cost, length, the audit of effect plans, hard trainings, the oracle ladder."""

from collections.abc import Sequence

from radiogs_core.capabilities import PARTS, Part
from radiogs_core.transport.plan import EFFECTS

from .experiment import AUDIT, COST
from .suite import JUDGED, Row, Suite, metrics

EVERY_PART = metrics(
    "nvs/psnr", "normal/mae", "albedo/psnr", "roughness/mse", "relight/psnr", "indirect/psnr",
    "environment/error_scaled",
)  # fmt: skip
"""Images, and every part of a model: shape, materials, light, and the light between surfaces."""


def _parts(factor: float) -> str:
    """A factor as a word for keys: ``1/4`` is ``quarter``."""
    return {
        0.1: "tenth", 0.2: "fifth", 0.25: "quarter", 0.4: "two-fifths", 0.5: "half", 0.7: "seven-tenths", 1.0: "whole",
        2.0: "double", 4.0: "fourfold",
    }[factor]  # fmt: skip


ITERATIONS = "<finetune_iterations>"

FINETUNED: tuple[tuple[str, str], ...] = (("finetuned", "PBR finetuned"), ("surfels", "Surfel finetuned"))

FINETUNE = Suite(
    name="finetune",
    title="Fine-tuning under a new light: quality by iterations, and when it pays",
    published=None,
    reference="split-sum",
    rows=(
        Row("split-sum", "PBR split-sum", "PBR split-sum", {"relighting": "pbr"}),
        *(
            Row(
                f"{mode}-{_parts(factor)}",
                f"{text}, {ITERATIONS} it.", f"{text}, {ITERATIONS} iterations (x {factor:g})",
                {"relighting": mode}, {"finetune_iterations": factor},
            )
            for mode, text in FINETUNED
            for factor in (0.1, 0.2, 0.4, 0.7, 1.0)
        ),
    ),
    columns=metrics("relight/psnr,ssim,lpips", "render/ms", "prepare/ms"),
)  # fmt: skip


def _knob(key: str, latex: str, text: str, factors: Sequence[float], *fields: str) -> tuple[Row, ...]:
    """One row per factor of a field of the budget, or of several fields that change together."""
    shown = [f"<{field}>" for field in fields]
    return tuple(
        Row(
            f"{key}-{_parts(factor)}",
            rf"{latex} $\times{factor:g}={','.join(shown)}$",
            f"{text} x {factor:g} = {' and '.join(shown)}",
            {},
            dict.fromkeys(fields, factor),
        )
        for factor in factors
    )


COST_OF_ACCURACY = Suite(
    name="cost",
    title="What accuracy costs in time",
    published=None,
    reference="reference",
    rows=(
        Row("reference", "All of the preset", "The preset as it is", {}),
        *_knob("stage1", "Stage 1", "steps of stage 1", (0.5, 2.0), "geometry.steps"),
        *_knob(
            "surfels", "Surfels", "surfels at the start and at most", (0.5, 2.0), "geometry.initial_surfels",
            "geometry.maximum_surfels",
        ),
        *_knob("iterations", "Iterations", "iterations", (0.25, 0.5, 2.0), "inverse_iterations"),
        *_knob("ns", "$N_s$", "N_s", (0.5, 2.0), "incident_samples"),
        *_knob("ng", "$N_g$", "N_g", (0.5, 2.0), "consistency_surfels"),
        *_knob("refresh", "Refresh interval", "refresh interval", (0.5, 2.0), "refresh_interval"),
        *_knob("light", "Light's rows", "rows of the light", (0.5, 2.0), "light_height"),
        *_knob(
            "relit-rays", "Relit rays", "rays of a relit surfel, over the hemisphere and from the light", (0.25, 4.0),
            "relight_hemisphere_samples", "relight_light_samples",
        ),
        Row(
            "draft", "Draft",
            "draft, half of all: <inverse_iterations> iterations, N_s <incident_samples>, N_g <consistency_surfels>",
            {},
            {"inverse_iterations": 0.5, "incident_samples": 0.5, "consistency_surfels": 0.5},
        ),
        Row("no-search", "No search", "light learnt from a constant one", {"materials.start.light": "constant"}),
        Row("split-sum", "Split-sum", "stage 2 by split sum, without rays", {"shading": "split-sum"}),
    ),
    columns=metrics(
        "nvs/psnr", "normal/mae", "albedo/psnr", "relight/psnr", "indirect/psnr", "render/ms", "training/megabytes"
    ),
    scenes=JUDGED,
    experiment=COST,
)  # fmt: skip
"""Settings of both stages and of relighting, varied one at a time. The search for the light is only left out, in one
row. Its rays count in every other row, also in the row of the split sum."""


STEPS = "<inverse_iterations>"

LENGTH = Suite(
    name="length",
    title="Quality by the length of stage 2",
    published=None,
    reference="steps-1",
    rows=tuple(
        Row(f"steps-{name}", f"{STEPS} it.", f"{STEPS} steps", {}, {"inverse_iterations": factor})
        for name, factor in (("1", 1.0), ("2-5", 2.5), ("5", 5.0), ("10", 10.0))
    ),
    columns=EVERY_PART,
    scenes=("front_patterned", "crowd", "lamps", "nefertiti", "trophy", "grotto"),
)  # fmt: skip
"""The preset's steps, and up to ten times as many, on scenes of six kinds; three are by other hands."""


def _all_but(*left_out: str) -> dict[str, tuple[str, ...]]:
    return {"effects": tuple(name for name in EFFECTS if name not in left_out)}


EFFECTS_SUITE = Suite(
    name="effects",
    title="Simulating only the effects that a scene needs",
    published=None,
    reference="everything",
    rows=(
        Row("everything", "Everything", "everything", {}),
        Row("auto", "By evidence (auto)", "by evidence (effects: auto)", {"effects": "auto"}),
        Row("no-rays", "No rays", "no visibility, no indirect light", _all_but("visibility", "indirect")),
        Row("no-indirect", "No indirect light", "no indirect light", _all_but("indirect")),
        Row("no-specular", "No specular", "no specular part", _all_but("specular")),
    ),
    columns=metrics(
        "nvs/psnr", "albedo/psnr", "roughness/mse", "relight/psnr", "plan/bound,worst", "stage2/rays,seconds",
        "training/seconds",
    ),
    scenes=(
        "convex", "patchwork", "occluder", "wire", "corner", "red_white", "bowl", "glossy", "mirror",
        "niche", "knot", "print",
    ),
    experiment=AUDIT,
)  # fmt: skip
"""The rows after ``auto`` switch effects off by hand, to show what that costs where they matter."""


HARD_TRAINING = Suite(
    name="hard-training",
    title="Hard cases: whole trainings",
    published=None,
    reference=None,
    rows=(Row("ours", "RadioGS", "RadioGS", {}), Row("printed", "Printed", "RadioGS as printed", {}, recipe="printed")),
    columns=metrics("nvs/psnr", "normal/mae", "albedo/psnr", "relight/psnr", "indirect/psnr"),
    scenes=(
        "corner", "hard-scale-1e-4", "hard-scale-1e4", "hard-distance-1e3", "hard-bright-light", "hard-sun",
        "hard-4-pixels", "hard-two-views", "hard-black", "hard-white",
    ),
)  # fmt: skip
"""A miniature as it is, and under each condition of ``radiogs_datasets.hard_scenes``; ``--method`` takes another method
through them."""


def _row(key: str, text: str, *given: Part) -> Row:
    return Row(key, "", text, given=given)


def _without(*left: Part) -> Row:
    return _row(f"all-but-{'-'.join(left)}", f"all but {' and '.join(left)}", *(p for p in PARTS if p not in left))


ORACLES = Suite(
    name="oracles",
    title="What each part of the truth is worth",
    published=None,
    reference="none",
    rows=(
        _row("none", "nothing given"),
        *(_row(part, f"{part} given", part) for part in PARTS),
        _row("geometry-light", "geometry and light", "geometry", "light"),
        _row("geometry-indirect", "geometry and indirect light", "geometry", "indirect"),
        _row("light-albedo", "light and albedo", "light", "albedo"),
        _row("geometry-light-indirect", "geometry, light and indirect light", "geometry", "light", "indirect"),
        *(_without("albedo", other) for other in ("geometry", "light", "indirect")),
        *(_without("light", other) for other in ("geometry", "roughness", "indirect")),
        *(_without(part) for part in PARTS),
        _row("all", "everything given", *PARTS),
    ),
    columns=EVERY_PART,
)
"""Sets of given parts, besides each part alone and all but each: shape and light, with and without indirect
light; shape and indirect light, which go together; light and albedo, which images cannot tell apart by themselves.

Rows that give all parts but two are needed, because given albedo fixes the metric of albedo: the value of another part
for it shows only between rows without albedo. The same holds for light, roughness and normals."""
