"""Settings of TensoIR: how much work a run does, how it learns, and what an ablation changes.

Defaults are those of its configurations for one light; shares are of the second stage's iterations.
"""

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from radiogs_core.errors import UsageError


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


BUDGET_SHOWN_ONLY = ("relight_samples",)
"""Fields of ``Budget`` that training does not read."""

BUDGET_INVERSE_ONLY = ("grid_end", "lobes", "light_rows", "secondary_samples", *BUDGET_SHOWN_ONLY)
"""Fields of ``Budget`` that the radiance field's stage does not read; its rates depend on the length of the other."""

PRESETS = {
    preset.name: preset
    for preset in (
        Budget(
            name="smoke", field_iterations=20, inverse_iterations=20, rays=64, views=4, grid_start=12, grid_end=16,
            cells=16, density_components=4, appearance_components=6, features=8, hidden=16, lobes=8, light_rows=4,
            secondary_samples=8, relight_samples=8, network_rate=3.0,
        ),
        Budget(
            name="tiny", field_iterations=1500, inverse_iterations=1500, rays=256, views=8, grid_start=32, grid_end=40,
            cells=64, density_components=8, appearance_components=12, features=12, hidden=32, lobes=32, light_rows=4,
            secondary_samples=16, relight_samples=64, network_rate=3.0,
        ),
        Budget(
            name="small", field_iterations=5000, inverse_iterations=10_000, rays=1024, views=8, grid_start=64,
            grid_end=128, cells=96, density_components=12, appearance_components=24, features=18, hidden=64, lobes=64,
            light_rows=8, secondary_samples=48, relight_samples=128, network_rate=2.0,
        ),
        Budget(
            name="paper", field_iterations=10_000, inverse_iterations=70_000, rays=4096, views=32, grid_start=128,
            grid_end=300, cells=256, density_components=16, appearance_components=48, features=27, hidden=128,
            lobes=128, light_rows=16, secondary_samples=96, relight_samples=512, network_rate=1.0,
        ),
    )
}  # fmt: skip


@dataclass(frozen=True)
class FieldWeights:
    """Weights of the losses of the radiance field alone; 0 leaves one out."""

    radiance: float = 1.0
    """Mean squared error of marched pixels, display values."""
    sparsity: float = 8e-5
    """Mean absolute entry of the density's planes and lines, summed over them."""
    density_variation: float = 0.05
    """A fiftieth of the mean squared differences of neighbouring entries of the density's planes."""
    appearance_variation: float = 0.005
    """The same of the appearance's planes."""


@dataclass(frozen=True)
class InverseWeights:
    """Weights of the losses of inverse rendering; 0 leaves one out."""

    radiance: float = 1.0
    """Mean squared error of marched pixels, display sRGB of linear radiance."""
    shaded: float = 0.2
    """Mean squared error of shaded pixels, display sRGB."""
    normal_difference: float = 0.002
    """Squared distance between predicted and derived normals along rays. Published: 0.0005 to 0.005, by scene."""
    orientation: float = 0.001
    """Squared cosine of predicted normals that face away along rays. Published: 0.001 to 0.005, by scene."""
    albedo_smoothness: float = 0.001
    """Squared relative difference between albedo here and nearby, along rays."""
    roughness_smoothness: float = 0.001
    """The same of roughness."""
    sparsity: float = 4e-5
    """As in ``FieldWeights``."""


@dataclass(frozen=True)
class Rates:
    """Adam's learning rates; both fall to ``end`` of themselves over both stages, and start anew with each grid."""

    grid: float = 0.02
    """Rate of planes and lines."""
    network: float = 0.001
    """Rate of the networks, the basis and the light, times the budget's ``network_rate``."""
    end: float = 0.1
    """What is left of them at the end."""


@dataclass(frozen=True)
class Schedule:
    """When the second stage does what, as shares of its iterations."""

    finer_at: tuple[float, ...] = (0.0, 1 / 7, 2 / 7, 3 / 7)
    """When the grid becomes finer, by the same factor each time."""
    emptied_at: tuple[float, ...] = (0.0, 1 / 14, 2 / 14, 3 / 14, 4 / 14, 5 / 14)
    """When cells without density are left out from then on."""


@dataclass(frozen=True)
class LightStart:
    """What the spherical Gaussians start as."""

    mean: float = 0.4
    """Radiance averaged over all directions (published: an energy of 1.6 pi)."""
    sharpness: float = 10.0
    """Least sharpness."""
    spread: float = 20.0
    """Scale of the half-normal that is added to it."""


@dataclass(frozen=True)
class Learning:
    """How both stages learn."""

    radiance_field: FieldWeights = field(default_factory=FieldWeights)
    """Losses of the radiance field alone."""
    inverse: InverseWeights = field(default_factory=InverseWeights)
    """Losses of inverse rendering."""
    rates: Rates = field(default_factory=Rates)
    """Learning rates."""
    schedule: Schedule = field(default_factory=Schedule)
    """Moments of the second stage."""
    light: LightStart = field(default_factory=LightStart)
    """What the light starts as."""
    nearby: float = 0.01 / 1.5
    """Standard deviation of the displacement at which smoothness compares materials, half edges of the box."""


SHOWN_ONLY = ("shown", "relight_visibility")
"""Fields of ``Variant`` that training does not read."""

INVERSE_ONLY = ("indirect", "visibility", "normals", "background", *SHOWN_ONLY)
"""Fields of ``Variant`` that the stage of the radiance field does not read."""


@dataclass(frozen=True)
class Variant:
    """A variant of TensoIR; the defaults are the full method.

    indirect: whether points are lit by the radiance that rays meet in the field. visibility: whether density on the
    way hides the light in training.
    normals: those that points are shaded with: of the network, tied to the density by a loss, or of the density itself.
    linear: whether the field's radiance is linear from the second stage on, as published, or from the start.
    background: what training images are composited on: white, as published, which a white surface is not told from; or
    from the second stage on a grey that is drawn for each ray. (From the start on, that leaves the field empty.)
    shown: what images under the recovered light are: the marched radiance field, which TensoIR's are, or shaded.
    relight_visibility: whether density hides the light in relighting.
    view_share: share of the training views that both stages may see, in (0, 1].
    learning: weights, rates and schedule.
    """

    indirect: bool = True
    visibility: bool = True
    normals: Literal["predicted", "derived"] = "predicted"
    linear: Literal["later", "from-start"] = "later"
    background: Literal["random-later", "white"] = "random-later"
    shown: Literal["field", "shaded"] = "field"
    relight_visibility: bool = True
    view_share: float = 1.0
    learning: Learning = field(default_factory=Learning)

    def __post_init__(self) -> None:
        if not 0 < self.view_share <= 1:
            raise UsageError(f"view_share: {self.view_share} is not above 0 and at most 1")
        schedule = self.learning.schedule
        for name in ("finer_at", "emptied_at"):
            if any(not 0 <= share < 1 for share in getattr(schedule, name)):
                raise UsageError(f"learning.schedule.{name}: {getattr(schedule, name)} are not all in [0, 1)")

    def of_training(self) -> dict[str, Any]:
        """The fields that decide the trained model, as plain values."""
        return {name: value for name, value in asdict(self).items() if name not in SHOWN_ONLY}

    def of_field(self) -> dict[str, Any]:
        """The fields that decide the radiance field of the first stage, as plain values."""
        found = {name: value for name, value in asdict(self).items() if name not in INVERSE_ONLY}
        learning = {name: found["learning"][name] for name in ("radiance_field", "rates")}
        return found | {"learning": learning}
