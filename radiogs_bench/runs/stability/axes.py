"""All axes, in the order of the suite's rows."""

from collections.abc import Mapping
from difflib import get_close_matches

from radiogs_core.errors import UsageError

from .curve import Axis
from .light import LIGHT_AXES
from .placement import PLACEMENT_AXES
from .surfels import SURFEL_AXES

AXES: Mapping[str, Axis] = {axis.key: axis for axis in (*SURFEL_AXES, *PLACEMENT_AXES, *LIGHT_AXES)}


def axis_and_points(settings: Mapping[str, float]) -> tuple[Axis, int]:
    """The axis that a row's settings name, and the number of points of its curves.

    Raises UsageError for anything else.
    """
    if len(settings) != 1:
        raise UsageError(
            f"a row of experiment 'stability' has the settings {dict(settings)}",
            "It has one: the name of an axis, and how many points its curves have.",
            "Such as:  settings = { roughness = 25 }",
        )
    ((name, points),) = settings.items()
    if name not in AXES:
        near = get_close_matches(name, AXES, 1)
        raise UsageError(
            f"there is no axis '{name}'", f"Did you mean '{near[0]}'?" if near else f"There are: {', '.join(AXES)}."
        )
    if points < 2 or points != int(points):
        raise UsageError(f"curves of {points:g} points", "A curve has two ends, and whole points.")
    return AXES[name], int(points)
