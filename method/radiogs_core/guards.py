"""Every numerical guard by name: the values it protects, its threshold, and the derivation of the threshold.

A guard keeps arithmetic from breaking by a rule that is not part of the formula. The constants are defined beside the
code that uses them; this table collects them. ``instruments.fire`` counts how often a guard acts. Guards that are not
counted are part of a formula and act on every value; counting them would cost a pass.
"""

from dataclasses import dataclass

from .kernels.arguments import MOST_ENTRIES
from .kernels.image.terms import MASK_CONFIDENCE
from .kernels.surfel.geometry import ALPHA_THRESHOLD, MAX_ALPHA, RASTER_TRANSMITTANCE_STOP, TRACE_TRANSMITTANCE_STOP
from .kernels.trace.bvh import COORDINATE_PADDING
from .kernels.trace.topology import DEEPEST
from .scene.camera import RIGID_TOLERANCE, STEEPEST_RAY
from .scene.colour import LINEAR_KNEE
from .surfels.surfels import ROUGHNESS_FLOOR


@dataclass(frozen=True)
class Guard:
    """One numerical guard."""

    name: str
    """Name of the guard, and of its counter in ``Instruments.guards``."""
    protects: str
    """Values that the guard protects, and from what."""
    derivation: str
    """Where the threshold comes from."""
    threshold: float | None = None
    """The threshold; None where the guard tests for zero or for finite values."""
    counted: bool = True
    """Whether a counter counts how often the guard acts."""
    refuses: bool = False
    """Whether the guard raises an error; other guards let the run continue."""


GUARDS = (
    Guard(
        "degenerate_surfels",
        "images and rays from a surfel with a NaN, an infinity or no extent",
        "no threshold: every number of the geometry and of its bounds must be finite",
    ),
    Guard(
        "faint_surfels",
        "bounds from the logarithm of an opacity below the cut-off",
        "one 8-bit level: a weaker surfel cannot change a stored image, and the support is finite",
        ALPHA_THRESHOLD,
    ),
    Guard(
        "saturable_surfels",
        "the backward pass from 1 / (1 - alpha); the counter counts surfels whose peak opacity is above the ceiling",
        "1 / (1 - 0.99) = 100: two digits of float32's seven",
        MAX_ALPHA,
    ),
    Guard(
        "full_pixels",
        "a pixel from long lists of surfels that are hidden",
        "(1 - MAX_ALPHA)^2: the transmittance behind two opaque surfels",
        RASTER_TRANSMITTANCE_STOP,
        counted=False,
    ),
    Guard(
        "full_rays",
        "a ray from long lists of hidden surfels; its values are divided by 1 - T, and V is 0",
        "the value of the paper, in its appendix on the tracer",
        TRACE_TRANSMITTANCE_STOP,
    ),
    Guard(
        "padded_boxes",
        "hits on the edge of a box from rounding of its corners",
        "about 10 ulp of a float32 coordinate",
        COORDINATE_PADDING,
        counted=False,
    ),
    Guard(
        "deep_trees",
        "a ray's stack: a deeper tree is replaced by one that is built by sorting",
        "1 + (STACK - 1) / (WIDTH - 1) levels",
        float(DEEPEST),
    ),
    Guard(
        "zero_lengths",
        "normals, quaternions and half-vectors from a division by a length of zero: zero stays zero, without gradient",
        "no threshold: the length is compared with zero itself",
        counted=False,
    ),
    Guard(
        "narrow_lobes",
        "learning from a highlight that falls between the light's texels",
        "a lobe of alpha = r^2 narrower than a texel cannot be learnt",
        ROUGHNESS_FLOOR,
        counted=False,
    ),
    Guard(
        "foot_of_the_curve",
        "the gradient from the infinite slope of x^(1/2.4) at 0",
        "the standard's own knee, below which the curve is a line",
        LINEAR_KNEE,
        counted=False,
    ),
    Guard(
        "sure_masks",
        "the entropy of a mask from log 0",
        "one wrong pixel costs at most 13.8 nats",
        MASK_CONFIDENCE,
        counted=False,
    ),
    Guard(
        "black_lights",
        "the light's density from 0 / 0: directions are drawn uniformly from a black map",
        "no threshold: the sum of its power is zero",
    ),
    Guard(
        "lights_not_sought",
        "stage 2's initial light from being estimated at too few points: it is constant then",
        "64 points in all training views: fewer are found only if hardly any pixel is opaque",
    ),
    Guard(
        "broken_lights",
        "drawing from a map with a texel that is not finite, which would receive every draw",
        "no threshold: every texel must be finite",
        refuses=True,
    ),
    Guard(
        "blind_lenses",
        "images from a lens whose rays are parallel to the image or not finite",
        "beyond a slope of 2^23 the forward axis is lost in a ray's float32 length",
        STEEPEST_RAY,
        refuses=True,
    ),
    Guard(
        "bent_poses",
        "images from a camera whose axes are scaled or sheared",
        "half a pixel at the edge of an image of 1000",
        RIGID_TOLERANCE,
        refuses=True,
    ),
    Guard(
        "uncountable_lists",
        "32-bit indices from wrapping around",
        "the largest 32-bit integer",
        float(MOST_ENTRIES),
        refuses=True,
    ),
    Guard(
        "broken_colours",
        "images and traced light from a surfel that is hit and whose colour is not finite",
        "no threshold: blended values must be finite",
        refuses=True,
    ),
    Guard(
        "broken_training",
        "all surfels from a loss or gradient that is not finite",
        "no threshold: every loss and gradient must be finite",
        refuses=True,
    ),
)
