"""The knobs of TensoIR's cost, as presets."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Budget:
    """How much work a run may do.

    ``rays`` of ``views`` training views are marched a step, first for ``field_iterations`` steps of the radiance field
    alone, then for ``inverse_iterations``. The grid has ``grid_start`` nodes an edge at first and ``grid_end`` in the
    end; the box is known to be empty or not by ``cells`` an edge. ``light_rows`` rows of twice as many directions are
    looked along for light, with ``secondary_samples`` samples each; relighting draws ``relight_samples`` from the
    light. ``network_rate`` multiplies the rates of networks and light: short runs take longer steps.
    """

    name: str
    field_iterations: int
    inverse_iterations: int
    rays: int
    views: int
    grid_start: int
    grid_end: int
    cells: int
    density_components: int
    appearance_components: int
    features: int
    hidden: int
    lobes: int
    light_rows: int
    secondary_samples: int
    relight_samples: int
    network_rate: float


SHOWN_ONLY = ("relight_samples",)
"""Fields that training does not read."""

INVERSE_ONLY = ("grid_end", "lobes", "light_rows", "secondary_samples", *SHOWN_ONLY)
"""Fields that the stage of the radiance field does not read; of the other stage's length its rates depend."""

PRESETS = {
    preset.name: preset
    for preset in (
        Budget("smoke", 20, 20, 64, 4, 12, 16, 16, 4, 6, 8, 16, 8, 4, 8, 8, 3.0),
        Budget("tiny", 1500, 1500, 256, 8, 32, 40, 64, 8, 12, 12, 32, 32, 4, 16, 64, 3.0),
        Budget("small", 5000, 10_000, 1024, 8, 64, 128, 96, 12, 24, 18, 64, 64, 8, 48, 128, 2.0),
        Budget("paper", 10_000, 70_000, 4096, 32, 128, 300, 256, 16, 48, 27, 128, 128, 16, 96, 512, 1.0),
    )
}
