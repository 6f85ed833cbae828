"""The oracle ladder: parts of what a method finds are replaced by the truth, to see what each is responsible for."""

from radiogs_core.capabilities import PARTS, Part

from .suite import Metric, Row, Suite


def _row(key: str, text: str, *given: Part) -> Row:
    return Row(key, "", text, given=given)


ORACLES = Suite(
    name="oracles",
    title="What each part is responsible for: parts of the truth given",
    published=None,
    reference="none",
    rows=(
        _row("none", "nothing given"),
        *(_row(part, f"{part} given", part) for part in PARTS),
        _row("geometry-light", "geometry and light", "geometry", "light"),
        _row("geometry-indirect", "geometry and indirect light", "geometry", "indirect"),
        _row("light-albedo", "light and albedo", "light", "albedo"),
        _row("geometry-light-indirect", "geometry, light and indirect light", "geometry", "light", "indirect"),
        *(_row(f"all-but-{part}", f"all but {part}", *(each for each in PARTS if each != part)) for part in PARTS),
        _row("all", "everything given", *PARTS),
    ),
    columns=(
        Metric("nvs", "psnr"), Metric("normal", "mae"), Metric("albedo", "psnr"), Metric("roughness", "mse"),
        Metric("relight", "psnr"), Metric("indirect", "psnr"), Metric("environment", "error_scaled"),
    ),
)  # fmt: skip
"""Pairs beside the single parts: what shape and light leave to the materials, with and without indirect light; shape
and indirect light, which go together; light and albedo, which images cannot tell apart by themselves."""
