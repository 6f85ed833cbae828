"""Where effects matter: how much leaving each out changes the pixels of a view."""

from collections.abc import Sequence
from dataclasses import replace

from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.colour import srgb_encode
from radiogs_core.transport.plan import HIGHEST_DEGREE, everything
from radiogs_core.transport.splatting import SOLID_ALPHA

from ..measure.covered_pixels import rendered_views
from ..measure.plan_radiance import PlanRadiance
from ..measure.probe_scene import ProbeScene
from ..measure.substitutes import plan_without
from ..measure.tile_errors import light_factor
from .assessment import light_factor_is_free


def difference_maps(
    subject: ProbeScene, effects: Sequence[str]
) -> tuple[Float[Tensor, "height width 3"], dict[str, Float[Tensor, "height width"]]]:
    """The first sight with everything on, and how much leaving each effect out changes each pixel, mean over channels.

    Both in display sRGB.
    """
    candidates = PlanRadiance(replace(subject, sights=subject.sights[:1]))
    plans = {effect: plan_without(effect) for effect in effects}
    radiance = {"shaded": candidates.radiance(everything()), "own": candidates.own(HIGHEST_DEGREE)}
    for effect, plan in plans.items():
        own = plan.sh_degree < HIGHEST_DEGREE
        radiance[effect] = candidates.own(plan.sh_degree) if own else candidates.radiance(plan)
    (picture,) = rendered_views(candidates.projections, [value.detach() for value in radiance.values()])
    images = dict(zip(radiance, picture.channels.split(3, -1), strict=True))
    covered = picture.alpha > SOLID_ALPHA
    maps = {}
    for effect, plan in plans.items():
        full, less = images["own" if plan.sh_degree < HIGHEST_DEGREE else "shaded"], images[effect]
        if light_factor_is_free(effect, subject):
            less = less * light_factor(less[covered], full[covered])
        maps[effect] = (srgb_encode(less) - srgb_encode(full)).abs().mean(-1)
    return srgb_encode(images["shaded"]), maps
