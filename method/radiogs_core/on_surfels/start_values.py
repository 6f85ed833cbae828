"""What materials and light of stage 2 start as, and how the light that they start with is sought.

These values are apart from the search itself (``light_start``): a stage that only hands them on does not depend on it.
"""

import math
from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True)
class LightStart:
    """How the light of least albedo variation is found."""

    steps: int = 300
    """Steps of Adam."""
    rate: float = 0.05
    """Its rate in log-radiance; it falls to zero."""
    neighbours: int = 8
    """Nearest points that each point is compared with."""
    far: int = 8
    """Points that each point is compared with as well, drawn from all of them: what lies apart in space and is lit
    otherwise says more about the light than what lies beside it."""
    far_share: float = 0.3
    """Share of the variation that comparisons with these have."""
    other_paint: float = 0.3
    """Difference in log-albedo towards which they saturate: points farther apart are of another paint, whatever the
    light."""
    same_paint: float = 0.08
    """Standard deviation in log-chromaticity up to which neighbours pass for the same paint."""
    smoothness: float = 0.003
    """Weight of squared differences of neighbouring texels' log-radiance."""
    colour: float = 0.02
    """Weight of the distance of the light's channels from their mean."""
    white_paint: float = 0.05
    """Weight of the squared distance between the logarithms of the brightest albedo and of white paint's."""
    white: float = 0.75
    """Albedo of white paint."""
    brightest: float = 0.95
    """Quantile of the largest channel of albedo that counts as the brightest."""
    mean_albedo: float = 0.4
    """Albedo of all points under the constant light that the search starts from."""
    turned: float = 0.5
    """Distance, in standard deviations of the points' positions, that a unit of difference in normals counts as."""
    albedo_range: tuple[float, float] = (0.02, 0.95)
    """Albedo that surfels start with at least and at most."""

    @property
    def white_log(self) -> float:
        """Logarithm of white paint's albedo."""
        return math.log(self.white)


@dataclass(frozen=True)
class StartValues:
    """The light and the materials that a stage starts with; each method's subclass has its own values."""

    light: Literal["least-variation", "constant"] = "least-variation"
    """The light under which albedo varies least, with the albedo that follows from it; or a constant light and a
    constant albedo, as in the published scripts."""
    search: LightStart = field(default_factory=LightStart)
    """How the light of least variation is found."""
    albedo: float = 0.5
    """Linear diffuse albedo of all channels under a constant light."""
    roughness: float = 0.5
    """Perceptual roughness r."""
    white: float = 0.8
    """Albedo of white paint. A constant light starts so that the brightest surfaces seen are that under it; the scripts
    start at fixed radiances, whatever the images' exposure."""
    brightest: float = 0.98
    """Quantile of the covered pixels that counts as the brightest."""
