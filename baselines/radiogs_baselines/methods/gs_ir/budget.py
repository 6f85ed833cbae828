"""The knobs of GS-IR's cost, as presets."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Budget:
    """How much work a run may do.

    Stage 1, shared with other methods: see ``radiogs_core.learning.fit_geometry.GeometryBudget``. Between the stages
    occlusion is baked on a lattice of ``occlusion_corners`` corners an edge by ``occlusion_directions`` rays from each
    corner near a surface. Stage 2: ``inverse_iterations`` steps, of all pixels of one view; the occlusion of each is a
    mean over ``occlusion_samples`` directions. ``irradiance_corners``: corners an edge of the volume of indirect
    irradiance. ``light_height``: height of the learnt environment map.
    """

    name: str
    initialise_iterations: int
    initial_surfels: int
    maximum_surfels: int
    densify_interval: int
    geometry_rate: float
    inverse_iterations: int
    occlusion_corners: int
    occlusion_directions: int
    occlusion_samples: int
    irradiance_corners: int
    light_height: int


PRESETS = {
    preset.name: preset
    for preset in (
        Budget("smoke", 60, 400, 600, 20, 12.0, 20, 8, 64, 16, 6, 8),
        Budget("tiny", 2000, 6000, 6000, 100, 12.0, 600, 32, 256, 32, 32, 16),
        Budget("small", 5000, 20_000, 50_000, 200, 5.0, 2500, 64, 1024, 128, 32, 32),
        Budget("paper", 40_000, 100_000, 2_000_000, 500, 1.0, 5000, 128, 4096, 256, 64, 32),
    )
}
"""Stage 1 is RadioGS's, so that both methods' rows have the same."""
