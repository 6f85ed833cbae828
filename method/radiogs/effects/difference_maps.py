"""Where effects matter: how much leaving each out changes the pixels of a view."""

from collections.abc import Sequence
from dataclasses import replace

from jaxtyping import Float
from torch import Tensor

from radiogs_core.kernels.image.display import displayed
from radiogs_core.transport.plan import HIGHEST_DEGREE, everything
from radiogs_core.transport.splatting import SOLID_ALPHA

from .assessment import light_factor_is_free
from .covered_pixels import rendered_views
from .plan_radiance import PlanRadiance
from .probe_scene import ProbeScene
from .substitutes import plan_without
from .tile_errors import light_factor


def difference_maps(
    scene: ProbeScene, effects: Sequence[str]
) -> tuple[Float[Tensor, "height width 3"], dict[str, Float[Tensor, "height width"]]]:
    """The first view with everything on, and how much leaving each effect out changes each pixel, mean over channels.

    Both in display sRGB.
    """
    radiance = PlanRadiance(replace(scene, views=scene.views[:1]))
    plans = {effect: plan_without(effect) for effect in effects}
    sent = {"shaded": radiance.shaded(everything()), "own": radiance.own(HIGHEST_DEGREE)}
    for effect, plan in plans.items():
        own = plan.sh_degree < HIGHEST_DEGREE
        sent[effect] = radiance.own(plan.sh_degree) if own else radiance.shaded(plan)
    (rendered,) = rendered_views(radiance.projections, [value.detach() for value in sent.values()])
    images = dict(zip(sent, rendered.channels.split(3, -1), strict=True))
    covered = rendered.alpha > SOLID_ALPHA

    def shown(linear: Tensor) -> Tensor:
        return displayed(linear, rendered.alpha, scene.straight)

    maps = {}
    for effect, plan in plans.items():
        full, less = images["own" if plan.sh_degree < HIGHEST_DEGREE else "shaded"], images[effect]
        if light_factor_is_free(effect, scene):
            less = less * light_factor(less[covered], full[covered])
        maps[effect] = (shown(less) - shown(full)).abs().mean(-1)
    return shown(images["shaded"]), maps
