"""Indirect light under a given light, bounce by bounce along one set of rays, with met surfaces that are Lambertian.

Every surfel has one set of directions, which all bounces share. Their rays are traced once as far as memory allows;
each bounce blends what they hit with the radiance that the bounce before has left on the surfels. A surface that a ray
hits scatters all it reflects by Lambert's law, the light of its specular lobe too (``lobe_albedo``).

``light_paths`` keeps so much of this that a viewer can relight the surfels without tracing rays.
"""

from collections.abc import Callable, Iterator

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from ..kernels.shade.brdf import diffuse
from ..kernels.shade.shade import shade
from ..kernels.trace.hits import HitLists
from ..scene.light_sampler import GOLDEN_RATIO
from .incident import Incident, unoccluded
from .plan import EffectPlan
from .sampling import sphere_directions
from .shading import bounded_albedo, lobe_albedo
from .splatting import DIFFUSE_DIRECT
from .tracer import EVERYTHING, RAYS_AT_ONCE, SurfelTracer

KEPT_BYTES = 1 << 30
"""Most bytes of hits that are kept between bounces; rays whose hits do not fit are traced anew in every bounce."""

MOST_LEFT = 0.95
"""Largest share of the light of a bounce that the next one is taken to have when the rest of the series is added."""


class FixedRays:
    """Rays of all surfels in fixed directions, whose hits are kept up to a number of bytes.

    Args:
        tracer: Traces the rays.
        direction: Unit directions of all surfels.
        kept_bytes: Most bytes of hits that are kept.
    """

    def __init__(self, tracer: SurfelTracer, direction: Float[Tensor, "surfels samples 3"], kept_bytes: int) -> None:
        self.tracer, self.direction = tracer, direction
        every = torch.arange(len(direction), device=direction.device)
        self.chunks = every.split(max(1, RAYS_AT_ONCE // direction.shape[1]))
        self.left = kept_bytes
        self.kept: dict[int, HitLists] = {}

    def arriving(
        self, radiance: Float[Tensor, "surfels 3"]
    ) -> Iterator[tuple[Int[Tensor, " some"], Float[Tensor, "some samples"], Float[Tensor, "some samples 3"]]]:
        """Some surfels at a time, with V and L_ind along their rays if surfels send ``radiance`` to their front."""
        for place, some in enumerate(self.chunks):
            along = self.direction[some]
            found = self.kept[place] if place in self.kept else self.tracer.hits(some, along)
            size = sum(each.nbytes for each in vars(found).values())
            if place not in self.kept and size <= self.left:
                self.kept[place] = found
                self.left -= size
            yield some, *self.tracer.blended(found, along, radiance)


@torch.no_grad()
def bounced_incident(
    tracer: SurfelTracer,
    albedo: Float[Tensor, "surfels 3"],
    environment: Float[Tensor, "rows columns 3"],
    directions: tuple[Float[Tensor, "surfels samples 3"], Float[Tensor, "surfels samples"]],
    bounces: int,
    plan: EffectPlan = EVERYTHING,
    lamps: Incident | None = None,
) -> Incident:
    """Incident light whose L_ind has met up to ``bounces`` surfaces, and an estimate of what would follow.

    ``albedo``: linear, used instead of the surfels'. ``environment``: distant light, linear RGB, lat-long.
    ``directions``: unit directions and their solid angles. ``plan``: the effects that are traced; the others have the
    substitutes (``SurfelTracer.untraced``). ``lamps``: their light on the surfels (``lamp_light``), which L_ind begins
    with, too.
    """
    surfels, (direction, weight) = tracer.surfels, directions
    normal, roughness = surfels.frame[..., 2].detach(), surfels.roughness.detach()
    reflectance = bounded_albedo(albedo, roughness) + lobe_albedo(roughness)[:, None]
    every, dark = torch.arange(len(albedo), device=albedo.device), torch.zeros_like(albedo)
    incident = unoccluded(direction, weight) if plan.traces_all else tracer.untraced(every, direction, weight)
    rays = FixedRays(tracer, direction, KEPT_BYTES)
    if plan.visibility:
        for some, visibility, _ in rays.arriving(dark):
            incident.visibility[some] = visibility
    if not plan.indirect:
        return incident
    no_lobe = torch.zeros(len(albedo), dtype=torch.bool, device=albedo.device)
    direct = shade(
        normal, reflectance, roughness, normal[:, None], direction, weight, incident.visibility, incident.radiance,
        environment, no_lobe,
    )[:, 0, DIFFUSE_DIRECT]  # fmt: skip
    if lamps is not None:
        flow = lamps.weight * (lamps.direction * normal[:, None]).sum(-1).clamp(min=0)
        direct = direct + diffuse(reflectance) * (flow[..., None] * lamps.radiance).sum(1)

    def again(sent: Tensor) -> Tensor:
        scattered = dark.clone()
        for some, _, arriving in rays.arriving(sent):
            mean = mean_over_cosine(normal[some], direction[some], weight[some], arriving)
            scattered[some] = reflectance[some] * mean
        return scattered

    for some, _, arriving in rays.arriving(summed(direct, again, bounces)):
        incident.radiance[some] = arriving
    return incident


def mean_over_cosine(
    normal: Float[Tensor, "surfels 3"],
    direction: Float[Tensor, "surfels samples 3"],
    weight: Float[Tensor, "surfels samples"],
    radiance: Float[Tensor, "surfels samples 3"],
) -> Float[Tensor, "surfels 3"]:
    """Mean of incident radiance, weighted by solid angle and cosine: what a white Lambertian surface sends.

    The weights of a surfel are divided by their sum, whose expected value is pi. By chance it is larger for some
    surfels, which without the division would send more light than they receive.
    """
    flow = weight * (direction * normal[:, None]).sum(-1).clamp(min=0)
    whole = flow.sum(-1, keepdim=True)
    return ((flow / torch.where(whole > 0, whole, 1.0))[..., None] * radiance).sum(1)


def summed(
    first: Float[Tensor, "surfels 3"], again: Callable[[Tensor], Tensor], count: int
) -> Float[Tensor, "surfels 3"]:
    """The sum of a series of radiances: ``count`` terms, each ``again`` of the one before, and the rest by estimate.

    The rest is a geometric series for each channel, whose ratio is the last two terms' (summed over surfels), at most
    MOST_LEFT. A single term has no ratio, and nothing is added.
    """
    total = term = first
    for number in range(1, count):
        before, term = term, again(term)
        total = total + term
        if number == count - 1:
            whole = before.sum(0)
            ratio = (term.sum(0) / torch.where(whole > 0, whole, 1.0)).clamp(0, MOST_LEFT)
            total = total + term * (ratio / (1 - ratio))
    return total


SEEN, ABOVE, MET = 512, 288, 32
"""Directions of ``light_paths``: over the sphere, from a surfel's horizon upwards, with the surfel that is met."""


@torch.no_grad()
def light_paths(
    tracer: SurfelTracer, index: Int[Tensor, " chosen"]
) -> tuple[Bool[Tensor, "chosen seen"], Int[Tensor, "chosen met"]]:
    """Whether surfels at ``index`` see the light along ``sphere_directions(SEEN)``, and which surfels they meet.

    They see it where V is at least one half, along the ABOVE directions of the largest cosine. Surfels are met along
    MET of them, drawn by the cosine: their mean stands for the hemisphere's. -1: the light, or a surfel's back.
    """
    normal = tracer.surfels.frame[..., 2]
    along, found = sphere_directions(SEEN).to(normal), []
    for some in index.split(RAYS_AT_ONCE // ABOVE):
        cosine = normal[some] @ along.T
        above = cosine.topk(ABOVE).indices.sort(1).values
        left, strongest = (each.view(-1, ABOVE) for each in strongest_hits(tracer.hits(some, along[above])))
        from_front = (normal[strongest.clamp(min=0)] * along[above]).sum(-1) < 0
        met = torch.where((left < 0.5) & from_front, strongest, -1)
        flow = cosine.gather(1, above).clamp(min=0).double().cumsum(1)
        shares = (torch.arange(MET, device=some.device) + some[:, None] * GOLDEN_RATIO % 1) / MET  # no two alike
        drawn = met.gather(1, torch.searchsorted(flow, shares * flow[:, -1:]).clamp(max=ABOVE - 1))
        found.append((torch.zeros_like(cosine, dtype=torch.bool).scatter(1, above, left >= 0.5), drawn))
    return torch.cat([seen for seen, _ in found]), torch.cat([each for _, each in found])


def strongest_hits(lists: HitLists) -> tuple[Float[Tensor, " rays"], Int[Tensor, " rays"]]:
    """Transmittance of each ray, and the surfel whose hit has the largest weight in its blend; -1 without a hit."""
    counts = lists.begin.diff()
    ray, kept = lists.ray.long().repeat_interleave(counts), torch.log1p(-lists.alpha.double())
    before = torch.cat([kept.new_zeros(1), kept.cumsum(0)])
    weight = (before[:-1] - before[lists.begin[:-1]].repeat_interleave(counts)).exp() * lists.alpha
    none = kept.new_zeros(len(lists.ray))
    largest = weight == none.scatter_reduce(0, ray, weight, "amax")[ray]
    surfel = torch.full_like(none, -1, dtype=torch.long)
    surfel[ray[largest]] = lists.surfel[largest].long()
    return none.index_add(0, ray, kept).exp(), surfel
