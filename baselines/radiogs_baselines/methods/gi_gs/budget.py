"""The knobs of GI-GS's cost, as presets."""

from dataclasses import dataclass

from radiogs_core.errors import UsageError


@dataclass(frozen=True)
class Budget:
    """How much work a run may do.

    Stage 1, shared with other methods: see ``radiogs_core.learning.fit_geometry.GeometryBudget``. Stage 2:
    ``inverse_iterations`` steps; each frame looks around from every pixel along the directions of a grid of
    ``azimuths`` by ``heights`` (see ``grid``), and at ``march_steps`` places a radius along each. ``light_height`` is
    the height of the learnt environment map. Frames that are shown have a grid of ``render_azimuths`` by
    ``render_heights``.
    """

    name: str
    initialise_iterations: int
    initial_surfels: int
    maximum_surfels: int
    densify_interval: int
    geometry_rate: float
    inverse_iterations: int
    azimuths: int
    heights: int
    march_steps: int
    light_height: int
    render_azimuths: int
    render_heights: int

    def __post_init__(self) -> None:
        for name in ("heights", "render_heights"):
            if getattr(self, name) < 3:
                raise UsageError(
                    f"{name}: {getattr(self, name)} is less than 3",
                    "The first one is the normal and the last one the horizon; neither counts.",
                )


SHOWN_ONLY = ("render_azimuths", "render_heights")
"""Fields that training does not read."""

PRESETS = {
    preset.name: preset
    for preset in (
        Budget("smoke", 60, 400, 600, 20, 12.0, 20, 8, 5, 8, 8, 8, 5),
        Budget("tiny", 2000, 6000, 6000, 100, 12.0, 600, 8, 5, 16, 16, 16, 9),
        Budget("small", 5000, 20_000, 50_000, 200, 5.0, 3000, 16, 9, 16, 32, 32, 17),
        Budget("paper", 40_000, 100_000, 2_000_000, 500, 1.0, 5000, 32, 17, 16, 64, 32, 17),
    )
}
"""Stage 1 and the size of the light are RadioGS's, so that both methods' rows have the same."""
