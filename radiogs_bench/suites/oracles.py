"""The oracle ladder: parts of what a method finds are replaced by the truth, to see what each is responsible for."""

from radiogs_core.capabilities import PARTS, Part

from .suite import Metric, Row, Suite


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
    columns=(
        Metric("nvs", "psnr"), Metric("normal", "mae"), Metric("albedo", "psnr"), Metric("roughness", "mse"),
        Metric("relight", "psnr"), Metric("indirect", "psnr"), Metric("environment", "error_scaled"),
    ),
)  # fmt: skip
"""Besides each part alone, and all but each: what shape and light leave to the materials, with and without indirect
light; shape and indirect light, which go together; light and albedo, which images cannot tell apart by themselves.

All but two: giving albedo settles the metric of albedo, so what another part is worth to it last out is seen only
between rows without albedo. Likewise for light; for roughness and normals as far as these rows go."""
