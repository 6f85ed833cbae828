"""The audit of effect plans: training with only the effects that a scene needs, against training with all."""

from radiogs_core.transport.plan import EFFECTS

from .experiment import AUDIT
from .suite import Metric, Row, Suite


def _without(*left_out: str) -> dict[str, tuple[str, ...]]:
    return {"effects": tuple(name for name in EFFECTS if name not in left_out)}


EFFECTS_SUITE = Suite(
    name="effects",
    title="Simulating only the effects that a scene needs",
    published=None,
    reference="everything",
    rows=(
        Row("everything", "Everything", "everything", {}),
        Row("auto", "By evidence (auto)", "by evidence (effects: auto)", {"effects": "auto"}),
        Row("no-rays", "No rays", "no visibility, no indirect light", _without("visibility", "indirect")),
        Row("no-indirect", "No indirect light", "no indirect light", _without("indirect")),
        Row("no-specular", "No specular", "no specular part", _without("specular")),
    ),
    columns=(
        Metric("nvs", "psnr"), Metric("albedo", "psnr"), Metric("roughness", "mse"), Metric("relight", "psnr"),
        Metric("plan", "bound"), Metric("plan", "worst"), Metric("stage2", "rays"),
        Metric("stage2", "seconds"), Metric("training", "seconds"),
    ),
    scenes=(
        "convex", "patchwork", "occluder", "wire", "corner", "red_white", "bowl", "glossy", "mirror",
        "niche", "knot", "print",
    ),
    experiment=AUDIT,
)  # fmt: skip
"""The rows after ``auto`` switch effects off by hand, to show what that costs where they matter."""
