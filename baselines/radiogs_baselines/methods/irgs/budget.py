"""The knobs of IRGS's cost, as presets."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Budget:
    """How much work a run may do.

    Stage 1, shared with other methods: see ``radiogs_core.learning.fit_geometry.GeometryBudget``. Stage 2:
    ``inverse_iterations`` steps; each shades ``pixels`` pixels of one view by ``incident_samples`` rays (N_s).
    ``light_height`` is the height of the learnt environment map. Images under the recovered light take
    ``render_samples`` rays a pixel; relit ones so many spread over the hemisphere and drawn from the light.
    """

    name: str
    initialise_iterations: int
    initial_surfels: int
    maximum_surfels: int
    densify_interval: int
    geometry_rate: float
    inverse_iterations: int
    pixels: int
    incident_samples: int
    light_height: int
    render_samples: int
    relight_hemisphere_samples: int
    relight_light_samples: int


SHOWN_ONLY = ("render_samples", "relight_hemisphere_samples", "relight_light_samples")
"""Fields that training does not read."""

PRESETS = {
    preset.name: preset
    for preset in (
        Budget("smoke", 60, 400, 600, 20, 12.0, 20, 64, 8, 8, 8, 8, 8),
        Budget("tiny", 2000, 6000, 6000, 100, 12.0, 600, 256, 32, 16, 64, 64, 64),
        Budget("small", 5000, 20_000, 50_000, 200, 5.0, 3000, 512, 64, 32, 128, 128, 64),
        Budget("paper", 40_000, 100_000, 2_000_000, 500, 1.0, 20_000, 1024, 256, 64, 512, 512, 256),
    )
}
"""Stage 1 and the size of the light are RadioGS's, so that both methods' rows have the same."""
