"""Images against the true surface: a point of one view's depth map has the same colour in other views."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from ..findings import Finding, warning
from .cameras import Array, Cameras, Fit
from .evidence import Evidence, Look
from .surface import Surface, sampled, seen, surface_of

FEWEST, MISSED = 40, 0.25
"""Points below which a view is not judged, and the largest difference of colour, display sRGB, that counts for a point;
also the difference of a point that a view does not show."""

TRIED = 1400
"""Points, at least, on which readings of a camera are tried."""

SUSPECT, SUSPECT_FROM, EXPLAINED = 2.0, 0.01, 0.5
"""Factor on the median difference of all views, and a summand, above which a view is suspected; and the share of its
difference that another reading of its camera may leave."""


def reprojection(evidence: Evidence) -> Iterator[Finding]:
    """Cameras under which a view differs from the true surface, and the reading that makes them agree."""
    surface = surface_of(evidence.truths)
    if surface is None:
        return
    colour = surface.values(evidence.truths, "image")
    costs = np.array([
        difference(surface, colour, look, evidence.cameras.take([place])) for place, look in enumerate(evidence.looks)
    ])  # fmt: skip
    usual, step = float(np.median(costs)), max(1, len(colour) // TRIED)
    few = Surface(surface.view[::step], (surface.pixel[0][::step], surface.pixel[1][::step]), surface.position[::step])
    for place in np.flatnonzero(costs > SUSPECT * usual + SUSPECT_FROM).tolist():
        look = evidence.looks[place]
        better, read = evidence.better_camera(place, partial(difference, few, colour[::step], look))
        left = difference(surface, colour, look, read)
        if left < EXPLAINED * costs[place]:
            what = "its image contradicts the surface of the test views"
            yield warning(look.name, Fit(better.says, left).explains(what, SUSPECT * usual + SUSPECT_FROM))


def difference(surface: Surface, colour: Array, look: Look, camera: Cameras) -> float:
    """Mean difference of display colour between surface and view under a camera; infinite if few are shown."""
    at, visible = seen(surface, camera)
    if int(visible.sum()) < FEWEST:
        return np.inf
    found, alpha = sampled(look, at[visible])
    apart = np.abs(found - colour[visible]).mean(1).clip(max=MISSED)
    return float(np.where(alpha > 0.5, apart, MISSED).mean())
