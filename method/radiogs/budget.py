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
        Budget(
            name="smoke",
            initialise_iterations=60,
            initial_surfels=400,
            maximum_surfels=600,
            densify_interval=20,
            geometry_rate=12.0,
            inverse_iterations=20,
            consistency_surfels=64,
            incident_samples=8,
            refresh_interval=10,
            light_height=8,
            relight_hemisphere_samples=16,
            relight_light_samples=16,
            finetune_iterations=10,
            finetune_surfels=128,
            finetune_samples=16,
        ),
        Budget(
            name="tiny",
            initialise_iterations=2000,
            initial_surfels=6000,
            maximum_surfels=6000,
            densify_interval=100,
            geometry_rate=12.0,
            inverse_iterations=600,
            consistency_surfels=256,
            incident_samples=32,
            refresh_interval=100,
            light_height=16,
            relight_hemisphere_samples=64,
            relight_light_samples=64,
            finetune_iterations=200,
            finetune_surfels=512,
            finetune_samples=64,
        ),
        Budget(
            name="small",
            initialise_iterations=5000,
            initial_surfels=20_000,
            maximum_surfels=50_000,
            densify_interval=200,
            geometry_rate=5.0,
            inverse_iterations=3000,
            consistency_surfels=1024,
            incident_samples=64,
            refresh_interval=100,
            light_height=32,
            relight_hemisphere_samples=128,
            relight_light_samples=64,
            finetune_iterations=500,
            finetune_surfels=2048,
            finetune_samples=128,
        ),
        Budget(
            name="paper",
            initialise_iterations=40_000,
            initial_surfels=100_000,
            maximum_surfels=2_000_000,
            densify_interval=500,
            geometry_rate=1.0,
            inverse_iterations=20_000,
            consistency_surfels=4096,
            incident_samples=64,
            refresh_interval=100,
            light_height=64,
            relight_hemisphere_samples=256,
            relight_light_samples=128,
            finetune_iterations=2000,
            finetune_surfels=8192,
            finetune_samples=256,
        ),
    )
}
