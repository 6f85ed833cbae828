"""How TensoIR learns: every weight, rate and moment as data; defaults are those of its configurations for one light.

Shares are of the second stage's iterations.
"""

from dataclasses import dataclass, field


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
