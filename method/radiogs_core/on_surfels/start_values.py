"""Initial values of materials and light in stage 2, and settings of the search for the light (``light_start``).

They have a module of their own, so that a stage that only stores them does not depend on the search.
"""

from dataclasses import dataclass, field
from typing import Literal

from ..plain_values import require
from ..surfels.surfels import require_roughness


@dataclass(frozen=True)
class LightStart:
    """How the light of least albedo variation is searched for."""

    steps: int = 300
    """Steps of Adam."""
    rate: float = 0.05
    """Adam's learning rate for log-radiance; it falls linearly to zero."""
    rows: int = 16
    """Largest number of rows of the estimated light; a larger light map is interpolated from it."""
    neighbours: int = 8
    """Number of nearest points that each point is compared with."""
    far: int = 8
    """Number of random points that each point is compared with in addition. Distant points have different irradiance,
    so they constrain the light more than neighbours do."""
    far_share: float = 0.3
    """Share of these random pairs in the variation."""
    other_paint: float = 0.3
    """Difference in log-albedo at which random pairs saturate: a larger one means different paints under any light."""
    same_paint: float = 0.2
    """Standard deviation, in log-chromaticity, of the weight of pairs: pairs of similar chromaticity share a paint. A
    paint has another chromaticity in the shadow of a coloured sun."""
    smoothness: float = 0.003
    """Weight of the squared differences of neighbouring texels' log-radiance."""
    chroma_smoothness: float = 0.1
    """Weight of the squared differences of neighbouring texels' log-chromaticity. A coloured sun in a coloured sky is
    not smooth in colour, but it is smoother than the light that explains painted walls by coloured texels."""
    colour: float = 0.003
    """Weight of the mean squared log-chromaticity of all light together. Only indirect light separates the colour of
    light from the colour of paint; with little indirect light the search would drift to any colour."""
    white_paint: float = 0.05
    """Weight of the squared difference between the logarithms of the brightest albedo and of ``white``."""
    white: float = 0.75
    """Albedo of white paint."""
    brightest: float = 0.9
    """Quantile of the points' albedo that counts as the brightest: of its largest channel, after a median over each
    point's neighbours. Without the median, errors of normals and visibility dominate the quantile, and the result is
    too dark."""
    mean_albedo: float = 0.4
    """Albedo of all points under the constant light that the search starts from."""
    turned: float = 0.5
    """Weight of distances between normals relative to distances between positions (in standard deviations of the
    positions) in the search for points near a surfel."""
    albedo_range: tuple[float, float] = (0.02, 0.95)
    """Smallest and largest initial albedo of surfels."""

    def __post_init__(self) -> None:
        require(self, "one or above", "steps", "neighbours", "rows")
        require(self, "zero or above", "rate", "far", "smoothness", "chroma_smoothness", "colour", "white_paint")
        require(self, "zero or above", "turned")
        require(self, "between 0 and 1", "far_share", "brightest")
        require(self, "above zero", "other_paint", "same_paint")
        require(self, "above 0 and below 1", "white", "mean_albedo", "albedo_range")


@dataclass(frozen=True)
class StartValues:
    """Initial light and materials of a stage; each method's subclass has its own defaults."""

    light: Literal["least-variation", "constant"] = "least-variation"
    """"least-variation": the light under which albedo varies least, and the albedo under it. "constant": a constant
    light and a constant albedo, as in the published scripts."""
    search: LightStart = field(default_factory=LightStart)
    """Settings of the search for the light of least variation."""
    albedo: float = 0.5
    """Linear diffuse albedo of all channels, with a constant light."""
    roughness: float = 0.5
    """Perceptual roughness r."""
    white: float = 0.8
    """Albedo of white paint. A constant light has the radiance that gives the brightest surfaces this albedo; the
    scripts start at fixed radiances, whatever the images' exposure."""
    brightest: float = 0.98
    """Quantile of the covered pixels that counts as the brightest."""

    def __post_init__(self) -> None:
        require(self, "above 0 and below 1", "albedo")
        require(self, "above zero", "white")
        require(self, "between 0 and 1", "brightest")
        require_roughness(self)
