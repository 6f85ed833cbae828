"""Suites without a table in the paper: quality against the cost of training and of fine-tuning."""

from collections.abc import Sequence

from .experiment import COST
from .suite import Metric, Row, Suite


def _parts(factor: float) -> str:
    """A factor in words, for keys: ``1/8`` is ``eighth``."""
    return {0.125: "eighth", 0.25: "quarter", 0.5: "half", 1.0: "whole", 2.0: "double", 4.0: "fourfold"}[factor]


ITERATIONS = "<finetune_iterations>"

FINETUNED: tuple[tuple[str, str], ...] = (("finetuned", "PBR finetuned"), ("surfels", "Surfel finetuned"))

FINETUNE = Suite(
    name="finetune",
    title="Fine-tuning under a new light: quality by iterations, and when it pays",
    published=None,
    reference="split-sum",
    rows=(
        Row("split-sum", "PBR split-sum", "PBR split-sum", {}),
        *(
            Row(
                f"{mode}-{_parts(factor)}",
                f"{text}, {ITERATIONS} it.", f"{text}, {ITERATIONS} iterations (x {factor:g})",
                {"relighting": mode}, {"finetune_iterations": factor},
            )
            for mode, text in FINETUNED
            for factor in (0.125, 0.25, 0.5, 1.0)
        ),
    ),
    columns=(
        *(Metric("relight", measure) for measure in ("psnr", "ssim", "lpips")),
        Metric("render", "ms"), Metric("prepare", "ms"),
    ),
)  # fmt: skip


def _knob(key: str, latex: str, text: str, field: str, factors: Sequence[float]) -> tuple[Row, ...]:
    """One row for each factor of a field of the budget."""
    return tuple(
        Row(
            f"{key}-{_parts(factor)}",
            rf"{latex} $\times{factor:g}=<{field}>$",
            f"{text} x {factor:g} = <{field}>",
            {},
            {field: factor},
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
        *_knob("iterations", "Iterations", "iterations", "inverse_iterations", (0.125, 0.25, 0.5)),
        *_knob("ns", "$N_s$", "N_s", "incident_samples", (0.25, 0.5, 2.0)),
        *_knob("ng", "$N_g$", "N_g", "consistency_surfels", (0.25, 0.5, 2.0)),
        *_knob("refresh", "Refresh interval", "refresh interval", "refresh_interval", (0.25, 4.0)),
        Row(
            "draft", "Draft",
            "draft, half of all: <inverse_iterations> iterations, N_s <incident_samples>, N_g <consistency_surfels>",
            {},
            {"inverse_iterations": 0.5, "incident_samples": 0.5, "consistency_surfels": 0.5},
        ),
        Row("split-sum", "Split-sum", "no visibility, no indirect light (split sum)", {"shading": "split-sum"}),
    ),
    columns=(
        Metric("nvs", "psnr"), Metric("normal", "mae"), Metric("albedo", "psnr"), Metric("relight", "psnr"),
        Metric("indirect", "psnr"),
    ),
    experiment=COST,
)  # fmt: skip
