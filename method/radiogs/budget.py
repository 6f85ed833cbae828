"""The knobs of cost, as presets from seconds on a laptop to the paper's hour on a GPU."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Budget:
    """How much work a run may do.

    Stage 1: ``initialise_iterations`` steps from ``initial_surfels`` random points, density control every
    ``densify_interval`` steps between 5 % and 62.5 % of them (the paper's 25k of 40k), never above
    ``maximum_surfels``; ``geometry_rate`` multiplies the rate of positions, and its root that of rotations: short runs
    take longer steps.
    Stage 2: ``inverse_iterations`` steps; each traces ``consistency_surfels`` (N_g) surfels by
    ``incident_samples`` (N_s) rays, and every ``refresh_interval`` steps all of them. ``light_height`` is the
    height of the learnt environment map. Relighting: rays per surfel spread over the hemisphere and drawn from
    the light. Stage 3: ``finetune_iterations`` steps of ``finetune_surfels`` surfels by ``finetune_samples`` rays.
    """

    name: str
    initialise_iterations: int
    initial_surfels: int
    maximum_surfels: int
    densify_interval: int
    geometry_rate: float
    inverse_iterations: int
    consistency_surfels: int
    incident_samples: int
    refresh_interval: int
    light_height: int
    relight_hemisphere_samples: int
    relight_light_samples: int
    finetune_iterations: int
    finetune_surfels: int
    finetune_samples: int


RELIGHT_ONLY = (
    "relight_hemisphere_samples", "relight_light_samples",
    "finetune_iterations", "finetune_surfels", "finetune_samples",
)  # fmt: skip
"""Fields that no stage of training reads: runs that differ in these alone share the trained model."""

INVERSE_ONLY = (
    "inverse_iterations", "consistency_surfels", "incident_samples", "refresh_interval", *RELIGHT_ONLY,
)  # fmt: skip
"""Fields that stage 1 does not read: runs that differ in these alone share it."""


PRESETS = {
    preset.name: preset
    for preset in (
        Budget("smoke", 60, 400, 600, 20, 12.0, 20, 64, 8, 10, 8, 16, 16, 10, 128, 16),
        Budget("tiny", 2000, 6000, 6000, 100, 12.0, 600, 256, 32, 100, 16, 64, 64, 200, 512, 64),
        Budget("small", 5000, 20_000, 50_000, 200, 5.0, 3000, 1024, 64, 100, 32, 128, 64, 500, 2048, 128),
        Budget("paper", 40_000, 100_000, 2_000_000, 500, 1.0, 20_000, 4096, 64, 100, 64, 256, 128, 2000, 8192, 256),
    )
}
