"""Where effects matter: how much leaving each out changes the pixels of a view."""

from collections.abc import Sequence
from dataclasses import replace

from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.colour import srgb_encode
from radiogs_core.transport.plan import HIGHEST_DEGREE, everything
from radiogs_core.transport.splatting import SOLID_ALPHA

from ..measure.candidates import Candidates
from ..measure.images import same_light
from ..measure.screen import splatted
from ..measure.subject import Subject
from ..measure.ways import altogether
from .judge import factor_is_free


def difference_maps(
    subject: Subject, effects: Sequence[str]
) -> tuple[Float[Tensor, "height width 3"], dict[str, Float[Tensor, "height width"]]]:
    """The first sight with everything on, and how much leaving each effect out changes each pixel, mean over channels.

    Both in display sRGB.
    """
    candidates = Candidates(replace(subject, sights=subject.sights[:1]))
    plans = {effect: altogether(effect) for effect in effects}
    radiance = {"shaded": candidates.radiance(everything()), "own": candidates.own(HIGHEST_DEGREE)}
    for effect, plan in plans.items():
        own = plan.sh_degree < HIGHEST_DEGREE
        radiance[effect] = candidates.own(plan.sh_degree) if own else candidates.radiance(plan)
    (picture,) = splatted(candidates.views, [value.detach() for value in radiance.values()])
    images = dict(zip(radiance, picture.channels.split(3, -1), strict=True))
    covered = picture.alpha > SOLID_ALPHA
    maps = {}
    for effect, plan in plans.items():
        full, less = images["own" if plan.sh_degree < HIGHEST_DEGREE else "shaded"], images[effect]
        if factor_is_free(effect, subject):
            less = less * same_light(less[covered], full[covered])
        maps[effect] = (srgb_encode(less) - srgb_encode(full)).abs().mean(-1)
    return srgb_encode(images["shaded"]), maps
