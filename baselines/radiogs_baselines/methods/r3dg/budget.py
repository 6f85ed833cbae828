"""The knobs of R3DG's cost, as presets."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Budget:
    """How much work a run may do.

    Stage 1, shared with other methods: see ``radiogs_core.learning.fit_geometry.GeometryBudget``. Stage 2:
    ``inverse_iterations`` steps; each shades all surfels by ``incident_samples`` directions (S), along which visibility
    was traced before, or, with ``Variant.visibility`` "retraced", is traced anew at ``retraced_surfels`` surfels a
    step. ``local_rate`` multiplies the rates of the local light (short runs take longer steps). ``light_height`` is
    the height of the learnt environment map. ``relight_samples``: directions of each surfel under another light.
    """

    name: str
    initialise_iterations: int
    initial_surfels: int
    maximum_surfels: int
    densify_interval: int
    geometry_rate: float
    inverse_iterations: int
    incident_samples: int
    retraced_surfels: int
    local_rate: float
    light_height: int
    relight_samples: int


SHOWN_ONLY = ("relight_samples",)
"""Fields that training does not read."""

PRESETS = {
    preset.name: preset
    for preset in (
        Budget("smoke", 60, 400, 600, 20, 12.0, 20, 8, 64, 4.0, 8, 16),
        Budget("tiny", 2000, 6000, 6000, 100, 12.0, 600, 32, 256, 4.0, 16, 128),
        Budget("small", 5000, 20_000, 50_000, 200, 5.0, 3000, 64, 1024, 2.0, 16, 192),
        Budget("paper", 40_000, 100_000, 2_000_000, 500, 1.0, 20_000, 64, 4096, 1.0, 16, 384),
    )
}
"""Stage 1 is RadioGS's, so that both methods' rows have the same."""
