"""Rays from surfels to surfels: what light arrives at them, and from where.

No distant light comes from below a surfel's horizon, the plane that it makes with its neighbours. Trained surfels lie
askew to the surface that they make together, 20 degrees at the median on a trained ``convex``. Of the hemisphere over
one alone, a part lies below that surface. Rays find this out; the horizon says so without them.
"""

import torch
from jaxtyping import Float, Int
from scipy.spatial import cKDTree
from torch import Tensor

from ..kernels.surfel.geometry import TRACE_TRANSMITTANCE_STOP, SplatGeometry
from ..kernels.surfel.support import support_of
from ..kernels.trace.bvh import SurfelBVH
from ..kernels.trace.trace import Hits, trace
from ..surfels.surfels import Surfels
from .incident import Incident
from .plan import EffectPlan
from .sampling import hemisphere_directions

SELF_OFFSET = 1.0
"""Rays start this many standard deviations of their own surfel away from it: neighbours that overlap the surfel
are the same surface seen twice, not occluders."""


BACK_OFFSET = 4.0
"""Rays meet surfels from behind, too, this many standard deviations of their own surfel on. What no camera has seen
of a solid has no surfels: a ray that enters it there must not leave it again on the other side. Nearer, it is the
surfels of the ray's own surface that are met from behind: they lie as a layer about as thick as they are wide."""


EVERYTHING = EffectPlan()


RAYS_AT_ONCE = 1 << 18
"""Their hits are in memory together: some hundred bytes a ray."""


class SurfelTracer:
    """Traces rays from surfels to surfels, or supplies the substitute for rays.

    Holds the bounding volumes, built for the first ray, and the surfels' neighbours, found when the first surfel has no
    rays.

    ``offset``: distance from their own surfel at which rays start, in its standard deviations; ``world_offset``: in
    world units instead. ``back_offset``: distance from which on rays meet surfels from behind, too, in its standard
    deviations; None: nowhere.
    """

    def __init__(
        self,
        surfels: Surfels,
        offset: float = SELF_OFFSET,
        world_offset: float | None = None,
        back_offset: float | None = BACK_OFFSET,
    ) -> None:
        self.offset, self.world_offset, self.back_offset = offset, world_offset, back_offset
        self._bvh: SurfelBVH | None = None
        self._neighbours: Int[Tensor, "surfels neighbours"] | None = None
        self.follow(surfels)
        # Tree and neighbours are those of these surfels whenever they are asked for, as in a run that is resumed.
        self._first = self.geometry

    def follow(self, surfels: Surfels) -> None:
        """Trace these surfels from now on: the same ones, moved a little (else make a new tracer)."""
        self.surfels = surfels
        self._geometry: SplatGeometry | None = None
        self._fitted = False

    def built(self) -> "SurfelTracer":
        """The tracer itself, its bounding volumes built: no ray, and no frame that is timed, waits for them."""
        _ = self.bvh
        return self

    def recolour(self, surfels: Surfels) -> None:
        """Trace these surfels from now on: the same ones at the same places, whose harmonics have changed.

        Nothing is fitted anew, and rays have gradient to the harmonics but not to the geometry of ``surfels``.
        """
        self.surfels = surfels

    @property
    def geometry(self) -> SplatGeometry:
        """The surfels that are followed, as rays meet them."""
        if self._geometry is None:
            self._geometry = self.surfels.geometry()
        return self._geometry

    @property
    def bvh(self) -> SurfelBVH:
        """The bounding volumes, fitted to the surfels that are followed."""
        if self._bvh is None:
            self._bvh = SurfelBVH.build(self._first.detach())
            self._fitted = self._first is self.geometry
        if not self._fitted:
            self._bvh.refit(self.geometry.detach())
            self._fitted = True
        return self._bvh

    def trace(
        self,
        index: Int[Tensor, " chosen"],
        direction: Float[Tensor, "chosen samples 3"],
        features: Float[Tensor, "surfels channels"],
    ) -> Hits:
        """Rays from the centres of the surfels ``index``; flattened to [chosen * samples] rays."""
        samples = direction.shape[1]
        origin = self.geometry.centre[index].repeat_interleave(samples, 0)
        width = self.surfels.scale.detach().max(-1).values[index].repeat_interleave(samples)
        reach = self.offset * width if self.world_offset is None else torch.full_like(width, self.world_offset)
        back_from = None if self.back_offset is None else self.back_offset * width
        return trace(
            self.bvh, self.geometry, self.surfels.sh, features,
            origin, direction.flatten(0, 1), reach, back_from=back_from,
        )  # fmt: skip

    def trace_from(
        self,
        origin: Float[Tensor, "rays 3"],
        direction: Float[Tensor, "rays 3"],
        features: Float[Tensor, "surfels channels"],
        start: Float[Tensor, " rays"],
        back_from: Float[Tensor, " rays"] | None = None,
    ) -> Hits:
        """Rays from any world ``origin``, beyond ``start``; see ``kernels.trace``. Offsets of surfels do not count."""
        return trace(self.bvh, self.geometry, self.surfels.sh, features, origin, direction, start, back_from=back_from)

    def incident(
        self,
        index: Int[Tensor, " chosen"],
        direction: Float[Tensor, "chosen samples 3"],
        weight: Float[Tensor, "chosen samples"],
        plan: EffectPlan = EVERYTHING,
    ) -> Incident:
        """Visibility and indirect radiance (Eq. 5) along given directions, with gradient to all surfels.

        What ``plan`` leaves out is not traced: see ``untraced``.
        """
        places = plan.traced_among(index)
        if not len(places):
            return self.untraced(index, direction, weight)
        none = self.geometry.centre.new_zeros(len(self.geometry), 0)
        hits = self.trace(index[places], direction[places], none)
        visibility, whole = visibility_of(hits)
        shape = (len(places), direction.shape[1])
        visibility, radiance = visibility.view(shape), (hits.radiance * whole[:, None]).view(*shape, 3)
        if plan.traces_all:
            return Incident(direction, weight, visibility, radiance)
        free = self.untraced(index, direction, weight)
        return Incident(
            direction,
            weight,
            free.visibility.index_copy(0, places, visibility) if plan.visibility else free.visibility,
            free.radiance.index_copy(0, places, radiance) if plan.indirect else free.radiance,
        )

    def untraced(
        self,
        index: Int[Tensor, " chosen"],
        direction: Float[Tensor, "chosen samples 3"],
        weight: Float[Tensor, "chosen samples"],
    ) -> Incident:
        """What stands for rays: V = 1 above the horizon and 0 below (see ``horizon``), L_ind = 0. No gradient."""
        if self._neighbours is None:
            self._neighbours = nearest_surfels(self._first)
        normal = patch_normal(self.surfels, index, self._neighbours)
        return Incident(direction, weight, above_horizon(direction, normal), torch.zeros_like(direction))


def visibility_of(hits: Hits) -> tuple[Float[Tensor, " rays"], Float[Tensor, " rays"]]:
    """V = T, and the factor that makes blended values whole.

    A ray that ended early (T < 3 %) met a solid surface: V is 0 and its values are divided by 1 - T, so that
    the rest neither leaks sunlight through walls nor is missing from the indirect light.
    """
    solid = hits.transmittance < TRACE_TRANSMITTANCE_STOP
    visibility = torch.where(solid, 0.0, hits.transmittance)
    return visibility, 1 / torch.where(solid, 1 - hits.transmittance, 1.0)


@torch.no_grad()
def gather_incident(
    tracer: SurfelTracer,
    surfels: Surfels,
    samples: int,
    generator: torch.Generator | None,
    floor: bool = False,
    plan: EffectPlan = EVERYTHING,
    index: Int[Tensor, " chosen"] | None = None,
) -> Incident:
    """Trace ``samples`` directions of the surfels ``index`` (None: of all), without gradient.

    ``generator`` None turns the random rotation off. ``floor``: see ``hemisphere_directions``.
    """
    normal = surfels.frame[..., 2] if index is None else surfels.take(index).frame[..., 2]
    direction, weight = hemisphere_directions(normal, samples, generator, floor)
    return incident_along(tracer, direction, weight, plan, index)


@torch.no_grad()
def incident_along(
    tracer: SurfelTracer,
    direction: Float[Tensor, "chosen samples 3"],
    weight: Float[Tensor, "chosen samples"],
    plan: EffectPlan = EVERYTHING,
    index: Int[Tensor, " chosen"] | None = None,
) -> Incident:
    """Trace the given directions of the surfels ``index`` (None: of all), as many rays at a time as memory likes.

    Without gradient.
    """
    together = max(1, RAYS_AT_ONCE // direction.shape[1])
    if index is None:
        index = torch.arange(len(direction), device=direction.device)
    arriving = Incident(direction, weight, torch.empty_like(weight), torch.empty_like(direction))
    for begin in range(0, len(index), together):
        some = slice(begin, begin + together)
        part = tracer.incident(index[some], direction[some], weight[some], plan)
        arriving.visibility[some], arriving.radiance[some] = part.visibility, part.radiance
    return arriving


NEIGHBOURS = 12

SAME_SURFACE = 0.1
"""Least cosine between the normals of neighbours of one surface: across a right angle begins another one."""


def nearest_surfels(geometry: SplatGeometry) -> Int[Tensor, "surfels neighbours"]:
    """Each surfel and the NEIGHBOURS nearest to it, or all where there are fewer.

    Surfels that no ray can hit are neighbours of themselves only.
    """
    solid = torch.nonzero(support_of(geometry).can_be_met)[:, 0]
    places = geometry.centre.detach()[solid].double().cpu().numpy()
    count = min(NEIGHBOURS + 1, len(places))
    around = torch.arange(len(geometry), device=solid.device)[:, None].repeat(1, max(1, count))
    if count:
        found = cKDTree(places).query(places, k=count)[1].reshape(len(places), count)
        around[solid] = solid[torch.from_numpy(found).to(solid.device)]
    return around


@torch.no_grad()
def patch_normal(
    surfels: Surfels, index: Int[Tensor, " chosen"], neighbours: Int[Tensor, "surfels neighbours"]
) -> Float[Tensor, "chosen 3"]:
    """Unit normals, world, of the surface that surfels make with their ``neighbours``: means weighted by opacity."""
    normal, opacity = surfels.frame[..., 2], surfels.opacity
    about = neighbours[index]
    cosine = (normal[about] * normal[index, None]).sum(-1)
    weight = torch.where(cosine > SAME_SURFACE, opacity[about], 0.0)
    return torch.nn.functional.normalize((weight[..., None] * normal[about]).sum(1), dim=-1)


def above_horizon(
    direction: Float[Tensor, "surfels samples 3"], normal: Float[Tensor, "surfels 3"]
) -> Float[Tensor, "surfels samples"]:
    """1 for the directions above the plane of a patch, 0 for those below."""
    return ((direction * normal[:, None]).sum(-1) > 0).to(direction)
