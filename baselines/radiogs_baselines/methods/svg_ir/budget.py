"""The knobs of SVG-IR's cost, as presets."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Budget:
    """How much work a run may do.

    Stage 1, shared with other methods: see ``radiogs_core.learning.fit_geometry.GeometryBudget``. Stage 2:
    ``inverse_iterations`` steps from a table of ``incident_samples`` (S) rays a surfel; each asks so many random
    surfels for consistency (``consistency_surfels``; as many as there are at most). ``light_height`` is the height of
    the learnt environment map. Relighting traces ``relight_samples`` rays a surfel.
    """

    name: str
    initialise_iterations: int
    initial_surfels: int
    maximum_surfels: int
    densify_interval: int
    geometry_rate: float
    inverse_iterations: int
    incident_samples: int
    consistency_surfels: int
    light_height: int
    relight_samples: int


SHOWN_ONLY = ("relight_samples",)
"""Fields that training does not read."""

PRESETS = {
    preset.name: preset
    for preset in (
        Budget("smoke", 60, 400, 600, 20, 12.0, 20, 8, 64, 8, 8),
        Budget("tiny", 2000, 6000, 6000, 100, 12.0, 600, 16, 1024, 16, 64),
        Budget("small", 5000, 20_000, 50_000, 200, 5.0, 3000, 32, 8192, 32, 128),
        Budget("paper", 40_000, 100_000, 2_000_000, 500, 1.0, 20_000, 64, 2_000_000, 64, 384),
    )
}
"""Stage 1 and the size of the light are RadioGS's, so that both methods' rows have the same."""
