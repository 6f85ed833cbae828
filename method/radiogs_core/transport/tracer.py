"""Rays from surfels to surfels: visibility of the distant light and indirect radiance from each direction.

No distant light comes from below a surfel's horizon, the plane of the surface that it forms with its neighbours.
Trained surfels are tilted against that surface, by 20 degrees at the median on a trained ``convex``, so a part of a
surfel's own hemisphere lies below the surface. Rays are blocked there by the neighbours; without rays the horizon
replaces them.
"""

from dataclasses import replace

import torch
from jaxtyping import Float, Int
from scipy.spatial import cKDTree
from torch import Tensor

from ..kernels.surfel.geometry import TRACE_TRANSMITTANCE_STOP, SplatGeometry
from ..kernels.surfel.support import support_of
from ..kernels.trace.bvh import SurfelBVH
from ..kernels.trace.hits import HitLists, find_hits
from ..kernels.trace.trace import Hits, blend_hits, trace
from ..surfels.surfels import Surfels, radiance_to_sh
from .incident import Incident
from .plan import EffectPlan
from .sampling import hemisphere_directions

SELF_OFFSET = 1.0
"""Distance from its own surfel at which a ray starts, in the surfel's larger standard deviation: nearer surfels belong
to the same surface and are not occluders."""


BACK_OFFSET = 4.0
"""Distance, in the same unit, beyond which a ray also hits surfels from behind. Parts of a solid that no camera has
seen have no surfels; a ray that enters the solid there must not leave it on the other side. Nearer hits from behind are
the surfels of the ray's own surface, which form a layer about as thick as they are wide."""


EVERYTHING = EffectPlan()
"""The plan that simulates all effects."""


RAYS_AT_ONCE = 1 << 18
"""Rays that are traced together; their hits take some hundred bytes a ray."""


class SurfelTracer:
    """Traces rays from surfels to surfels, or returns the substitute for rays.

    The bounding volumes are built for the first ray, and the surfels' neighbours are found for the first surfel without
    rays.

    Args:
        surfels: Surfels that are traced.
        offset: Distance from its own surfel at which a ray starts, in the surfel's larger standard deviation.
        world_offset: The same distance in world units, used instead of ``offset`` if it is not None.
        back_offset: Distance beyond which rays also hit surfels from behind, in the larger standard deviation of the
            ray's surfel; None: never.
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
        # Tree and neighbours are always built from these surfels, so that a resumed run builds the same ones.
        self._first = self.geometry

    def follow(self, surfels: Surfels) -> None:
        """Trace ``surfels`` from now on: the same surfels after a small move. For others make a new tracer."""
        self.surfels = surfels
        self._geometry: SplatGeometry | None = None
        self._fitted = False

    def built(self) -> "SurfelTracer":
        """This tracer, after building its bounding volumes, so that the first ray or timed frame does not wait."""
        _ = self.bvh
        return self

    @property
    def geometry(self) -> SplatGeometry:
        """Geometry of the current surfels for the tracing kernel."""
        if self._geometry is None:
            self._geometry = self.surfels.geometry()
        return self._geometry

    @property
    def bvh(self) -> SurfelBVH:
        """The bounding volumes, fitted to the current surfels."""
        if self._bvh is None:
            self._bvh = SurfelBVH.build(self._first.detach())
            self._fitted = self._first is self.geometry
        if not self._fitted:
            self._bvh.refit(self.geometry)
            self._fitted = True
        return self._bvh

    def trace(
        self,
        index: Int[Tensor, " chosen"],
        direction: Float[Tensor, "chosen samples 3"],
        features: Float[Tensor, "surfels channels"],
    ) -> Hits:
        """Trace rays from the centres of the surfels at ``index``; the result has chosen * samples rays."""
        origin, reach, back_from = self._starts(index, direction.shape[1])
        return trace(
            self.bvh, self.geometry, self.surfels.sh, features,
            origin, direction.flatten(0, 1), reach, back_from=back_from, rays_of_origin=direction.shape[1],
        )  # fmt: skip

    def hits(self, index: Int[Tensor, " chosen"], direction: Float[Tensor, "chosen samples 3"]) -> HitLists:
        """The hits of the rays of ``trace``, without gradient."""
        origin, reach, back_from = self._starts(index, direction.shape[1])
        rays = direction.flatten(0, 1)
        return find_hits(self.bvh, origin, rays, reach, back_from, rays_of_origin=direction.shape[1])

    @torch.no_grad()
    def blended(
        self,
        lists: HitLists,
        direction: Float[Tensor, "chosen samples 3"],
        radiance: Float[Tensor, "surfels 3"],
    ) -> tuple[Float[Tensor, "chosen samples"], Float[Tensor, "chosen samples 3"]]:
        """V and L_ind along rays with known ``hits``, from surfels that send ``radiance`` (linear RGB) to their front.

        The values equal ``incident`` for surfels with this radiance in all directions; without gradient.
        """
        rays, none = direction.flatten(0, 1), radiance.new_zeros(len(radiance), 0)
        # In units of the brightest surfel: harmonics are added to 1/2, where a dim light would lose its digits.
        unit = radiance.amax() if len(radiance) else radiance.new_zeros(())
        sh = radiance_to_sh(radiance / torch.where(unit > 0, unit, 1.0))[:, None].contiguous()
        # Blending reads origins for gradients alone.
        found = blend_hits(lists, self.geometry, sh, none, torch.empty_like(rays), rays)
        visibility, whole = visibility_of(found)
        shape = direction.shape[:2]
        return visibility.view(shape), (found.radiance * (unit * whole)[:, None]).view(*shape, 3)

    def _starts(
        self, index: Int[Tensor, " chosen"], samples: int
    ) -> tuple[Float[Tensor, "rays 3"], Float[Tensor, " rays"], Float[Tensor, " rays"] | None]:
        """Origins of rays from the surfels at ``index``, and the distances from which they hit fronts and backs."""
        each = index.repeat_interleave(samples)
        origin = self.geometry.centre.index_select(0, each)
        width = self.surfels.log_scale.detach().amax(-1).exp().index_select(0, each)
        reach = self.offset * width if self.world_offset is None else torch.full_like(width, self.world_offset)
        return origin, reach, None if self.back_offset is None else self.back_offset * width

    def trace_from(
        self,
        origin: Float[Tensor, "rays 3"],
        direction: Float[Tensor, "rays 3"],
        features: Float[Tensor, "surfels channels"],
        start: Float[Tensor, " rays"],
        back_from: Float[Tensor, " rays"] | None = None,
    ) -> Hits:
        """Trace rays from any world ``origin``, beyond the distance ``start``; see ``kernels.trace``.

        The offsets of this tracer do not apply.
        """
        return trace(self.bvh, self.geometry, self.surfels.sh, features, origin, direction, start, back_from=back_from)

    def incident(
        self,
        index: Int[Tensor, " chosen"],
        direction: Float[Tensor, "chosen samples 3"],
        weight: Float[Tensor, "chosen samples"],
        plan: EffectPlan = EVERYTHING,
    ) -> Incident:
        """Visibility and indirect radiance (Eq. 5) along given directions, with gradient to all surfels.

        Effects that ``plan`` leaves out get the substitutes of ``untraced``.
        """
        if not plan.traces or not len(index):
            return self.untraced(index, direction, weight)
        light = Incident(direction, weight, *self._through_surfels(index, direction))
        if plan.traces_all:
            return light
        free = self.untraced(index, direction, weight)
        return replace(light, radiance=free.radiance) if plan.visibility else replace(light, visibility=free.visibility)

    def _through_surfels(
        self, index: Int[Tensor, " chosen"], direction: Float[Tensor, "chosen samples 3"]
    ) -> tuple[Float[Tensor, "chosen samples"], Float[Tensor, "chosen samples 3"]]:
        """Visibility and indirect radiance along given directions of the surfels ``index``."""
        hits = self.trace(index, direction, self.geometry.centre.new_empty(len(self.geometry), 0))
        visibility, whole = visibility_of(hits)
        return visibility.view(direction.shape[:2]), (hits.radiance * whole[:, None]).view(direction.shape)

    def untraced(
        self,
        index: Int[Tensor, " chosen"],
        direction: Float[Tensor, "chosen samples 3"],
        weight: Float[Tensor, "chosen samples"],
    ) -> Incident:
        """The substitute for rays: V = 1 above the horizon and 0 below (``above_horizon``), L_ind = 0. No gradient."""
        if self._neighbours is None:
            self._neighbours = nearest_surfels(self._first)
        normal = patch_normal(self.surfels, index, self._neighbours)
        return Incident(direction, weight, above_horizon(direction, normal), torch.zeros_like(direction))


def visibility_of(hits: Hits) -> tuple[Float[Tensor, " rays"], Float[Tensor, " rays"]]:
    """Visibility V of each ray, and the factor by which its blended values are multiplied.

    V is the transmittance T. A ray that ended early (T < 3 %) hit a solid surface: its V is 0 and its factor is
    1 / (1 - T), so that the remaining T neither leaks distant light through walls nor is missing from the indirect
    light. The factor of other rays is 1.
    """
    solid = hits.transmittance < TRACE_TRANSMITTANCE_STOP
    visibility = hits.transmittance.masked_fill(solid, 0.0)
    return visibility, 1 / (1 - hits.transmittance).masked_fill(~solid, 1.0)


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
    """Trace ``samples`` directions of the surfels at ``index`` (None: all), without gradient.

    ``generator`` and ``floor``: see ``hemisphere_directions``. ``plan``: see ``SurfelTracer.incident``.
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
    """Trace given directions of the surfels at ``index`` (None: all), RAYS_AT_ONCE rays at a time, without gradient."""
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
"""Neighbours of each surfel."""

SAME_SURFACE = 0.1
"""Least cosine between the normals of neighbours that belong to one surface: across a right angle they do not."""


def nearest_surfels(geometry: SplatGeometry) -> Int[Tensor, "surfels neighbours"]:
    """Indices of each surfel and of the NEIGHBOURS nearest to it, or of all if there are fewer.

    A surfel that no ray can hit is the only neighbour of itself, and no neighbour of others.
    """
    solid = torch.nonzero(support_of(geometry).can_be_hit)[:, 0]
    positions = geometry.centre.detach()[solid].double().cpu().numpy()
    count = min(NEIGHBOURS + 1, len(positions))
    around = torch.arange(len(geometry), device=solid.device)[:, None].repeat(1, max(1, count))
    if count:
        found = cKDTree(positions).query(positions, k=count)[1].reshape(len(positions), count)
        around[solid] = solid[torch.from_numpy(found).to(solid.device)]
    return around


@torch.no_grad()
def patch_normal(
    surfels: Surfels, index: Int[Tensor, " chosen"], neighbours: Int[Tensor, "surfels neighbours"]
) -> Float[Tensor, "chosen 3"]:
    """Unit normals, in the world, of the surface around each surfel: the mean of its neighbours' normals, weighted by
    opacity."""
    normal, opacity = surfels.frame[..., 2], surfels.opacity
    about = neighbours[index]
    cosine = (normal[about] * normal[index, None]).sum(-1)
    weight = torch.where(cosine > SAME_SURFACE, opacity[about], 0.0)
    return torch.nn.functional.normalize((weight[..., None] * normal[about]).sum(1), dim=-1)


def above_horizon(
    direction: Float[Tensor, "surfels samples 3"], normal: Float[Tensor, "surfels 3"]
) -> Float[Tensor, "surfels samples"]:
    """1 for directions above the plane with the unit ``normal``, 0 for directions below."""
    return ((direction * normal[:, None]).sum(-1) > 0).to(direction)
