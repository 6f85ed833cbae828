"""Indirect light under a given light by path tracing: the reference for estimators of relighting.

A ray meets one of the surfels that it hits with the probability of that surfel's weight in the blend of ``trace``; the
path goes on from that surfel's centre, as all rays of a surfel do. At every surfel two rays are traced: one is drawn
from the light and one from the BRDF, and both bring distant light by the balance heuristic. The ray from the BRDF
continues the path. Materials are the same as in images, with the specular lobe, and paths have no last bounce: they end
by Russian roulette. So the mean over paths is the radiance of the model's own surfels under the light.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from ..kernels.shade.brdf import diffuse, ggx_distribution, specular
from ..kernels.surfel.geometry import TRACE_TRANSMITTANCE_STOP
from ..kernels.trace.hits import HitLists
from ..scene.light import EnvironmentMap
from ..scene.light_sampler import LightSampler
from .incident import Incident, unoccluded
from .sampling import tangent_frame
from .shading import bounded_albedo, lambert_albedo, lobe_albedo
from .tracer import RAYS_AT_ONCE, SurfelTracer

MOST_SURVIVAL = 0.95
"""Largest probability with which a path goes on, so that every path ends."""

LEAST_SHARE = 0.1
"""Least share of directions that are drawn from either part of the BRDF."""


@dataclass(frozen=True)
class Met:
    """The hits of rays: visibility, one of the surfels that each ray hits, and the surfels' share of its light."""

    visibility: Float[Tensor, " rays"]
    """V of the distant light (``visibility_of``)."""
    coverage: Float[Tensor, " rays"]
    """Sum of the weights of what the ray hits; 1 where V is 0."""
    surfel: Int[Tensor, " rays"]
    """A surfel, drawn with a probability in proportion to its weight; any surfel where ``coverage`` is 0."""


@dataclass(frozen=True)
class _Vertices:
    """The surfels that paths have met."""

    ray: Int[Tensor, " paths"]
    """Number of the ray that the path belongs to."""
    surfel: Int[Tensor, " paths"]
    outgoing: Float[Tensor, "paths 3"]
    """Unit direction from the surfel back along the path."""
    throughput: Float[Tensor, "paths 3"]
    """Factor of the radiance that the surfel sends along ``outgoing``."""

    def of(self, chosen: Bool[Tensor, " paths"]) -> "_Vertices":
        """The vertices of some paths."""
        return _Vertices(*(value[chosen] for value in vars(self).values()))


class PathTracer:
    """Traces paths through surfels under a light.

    Args:
        tracer: Traces the rays.
        albedo: Linear albedo, used instead of the surfels', because relighting scales it.
        light: Distant light.
        generator: Draws directions, surfels and the ends of paths.
        specular_at: Whether each surfel has a specular lobe (None: all); see ``shading.lambert_albedo``.
    """

    def __init__(
        self,
        tracer: SurfelTracer,
        albedo: Float[Tensor, "surfels 3"],
        light: EnvironmentMap,
        generator: torch.Generator,
        specular_at: Bool[Tensor, " surfels"] | None = None,
    ) -> None:
        surfels = tracer.surfels
        self.tracer, self.light, self.sampler, self.generator = tracer, light, LightSampler(light), generator
        self.normal, self.roughness = surfels.frame[..., 2].detach(), surfels.roughness.detach()
        bounded, lobe = bounded_albedo(albedo.detach(), self.roughness), lobe_albedo(self.roughness)
        self.albedo = lambert_albedo(bounded, self.roughness, specular_at)
        self.glossy = (lobe / (lobe + bounded.mean(-1))).clamp(LEAST_SHARE, 1 - LEAST_SHARE)
        if specular_at is not None:
            self.glossy = torch.where(specular_at, self.glossy, 0.0)

    @torch.no_grad()
    def incident(
        self,
        direction: Float[Tensor, "surfels samples 3"],
        weight: Float[Tensor, "surfels samples"],
        after_chunk: Callable[[], None] = lambda: None,
    ) -> Incident:
        """V along given directions, and L_ind estimated by one path per direction.

        ``after_chunk`` is called after the paths of some surfels; it may raise to end it.
        """
        found = unoccluded(direction, weight)
        every = torch.arange(len(direction), device=direction.device)
        for some in every.split(max(1, RAYS_AT_ONCE // (2 * direction.shape[1]))):
            found.visibility[some], found.radiance[some] = self.along(some, direction[some])
            after_chunk()
        return found

    @torch.no_grad()
    def along(
        self, index: Int[Tensor, " chosen"], direction: Float[Tensor, "chosen samples 3"]
    ) -> tuple[Float[Tensor, "chosen samples"], Float[Tensor, "chosen samples 3"]]:
        """V along directions from the surfels at ``index``, and L_ind estimated by one path per direction."""
        met = drawn_hit(self.tracer.hits(index, direction), self._uniform)
        arriving = torch.zeros_like(direction).flatten(0, 1)
        first = torch.arange(len(arriving), device=arriving.device)
        whole = met.coverage[:, None].expand_as(arriving)
        paths = self._facing(_Vertices(first, met.surfel, -direction.flatten(0, 1), whole))
        while len(paths.ray):
            paths = self._scatter(paths, arriving)
        return met.visibility.view(direction.shape[:2]), arriving.view_as(direction)

    def _scatter(self, paths: _Vertices, arriving: Float[Tensor, "rays 3"]) -> _Vertices:
        """Add the distant light that the paths' surfels send to ``arriving``; returns the next surfels."""
        from_light = self.sampler.draw(len(paths.ray), 1, self.generator)[:, 0]
        direction = torch.stack([from_light, self._drawn(paths)], 1)
        met = drawn_hit(self.tracer.hits(paths.surfel, direction), self._uniform)
        reflected, density = self.reflected(paths.surfel, paths.outgoing, direction)
        both = density + self.sampler.pdf(direction)
        seen = (met.visibility.view(both.shape) / torch.where(both > 0, both, torch.inf))[..., None]
        lit = (reflected * seen * self.light.lookup(direction)).sum(1)
        arriving.index_add_(0, paths.ray, paths.throughput * lit)
        onward = density[:, 1]
        kept = reflected[:, 1] / torch.where(onward > 0, onward, torch.inf)[:, None]
        throughput = paths.throughput * kept * met.coverage.view(both.shape)[:, 1, None]
        survival = throughput.amax(-1).clamp(max=MOST_SURVIVAL)
        goes_on = self._uniform(len(survival)) < survival
        throughput = throughput / torch.where(survival > 0, survival, 1.0)[:, None]
        surfel = met.surfel.view(both.shape)[:, 1]
        return self._facing(_Vertices(paths.ray, surfel, -direction[:, 1], throughput).of(goes_on))

    def _facing(self, paths: _Vertices) -> _Vertices:
        """The paths that meet the front of a surfel and carry light; surfels are black from behind."""
        front = (self.normal[paths.surfel] * paths.outgoing).sum(-1) > 0
        return paths.of(front & (paths.throughput > 0).any(-1))

    def _drawn(self, paths: _Vertices) -> Float[Tensor, "paths 3"]:
        """A direction of each path from the BRDF: from its lobe with the probability ``glossy``, else by the cosine."""
        normal, share = self.normal[paths.surfel], self._uniform(len(paths.ray))
        azimuth = 2 * torch.pi * self._uniform(len(share))
        alpha_squared = self.roughness[paths.surfel].square().square()
        from_lobe = self._uniform(len(share)) < self.glossy[paths.surfel]
        # Squared cosine between normal and direction: of the half-vector for the lobe.
        square = torch.where(from_lobe, (1 - share) / (1 + (alpha_squared - 1) * share), 1 - share)
        sine, cosine = (1 - square).clamp(min=0).sqrt(), square.clamp(min=0).sqrt()
        local = torch.stack([sine * azimuth.cos(), sine * azimuth.sin(), cosine], -1)
        vector = normalize((tangent_frame(normal) * local[:, None]).sum(-1), dim=-1)
        mirrored = 2 * (paths.outgoing * vector).sum(-1, keepdim=True) * vector - paths.outgoing
        return torch.where(from_lobe[:, None], normalize(mirrored, dim=-1), vector)

    def reflected(
        self,
        surfel: Int[Tensor, " paths"],
        outgoing: Float[Tensor, "paths 3"],
        direction: Float[Tensor, "paths samples 3"],
    ) -> tuple[Float[Tensor, "paths samples 3"], Float[Tensor, "paths samples"]]:
        """BRDF times cosine from ``direction`` to ``outgoing``, and the density per steradian of ``direction``."""
        shape = direction.shape[:2]
        normal, wo = (value[:, None].expand_as(direction) for value in (self.normal[surfel], outgoing))
        roughness = self.roughness[surfel][:, None].expand(shape)
        cosine = (normal * direction).sum(-1).clamp(min=0)
        glossy = self.glossy[surfel][:, None]
        lobe = torch.where(glossy > 0, specular(normal, wo, direction, roughness), 0.0)
        value = (diffuse(self.albedo[surfel])[:, None] + lobe[..., None]) * cosine[..., None]
        half = normalize(wo + direction, dim=-1)
        by_lobe = ggx_distribution(half, normal, roughness) * (normal * half).sum(-1) / (4 * (wo * half).sum(-1))
        density = glossy * by_lobe + (1 - glossy) * cosine / torch.pi
        return value, torch.where(cosine > 0, density, 0.0)

    def _uniform(self, count: int) -> Float[Tensor, " {count}"]:
        device, kind = self.normal.device, self.normal.dtype
        return torch.rand(count, generator=self.generator, device=device, dtype=kind)


def drawn_hit(lists: HitLists, uniform: Callable[[int], Tensor]) -> Met:
    """One of the hits of each ray. ``uniform`` draws numbers in [0, 1).

    With transmittance T, hit k has the probability w_k / (1 - T): it is the first hit behind which the transmittance is
    below 1 - u (1 - T). A ray that ended early counts as fully covered (``visibility_of``).
    """
    begin, end = lists.begin[:-1], lists.begin[1:]
    # Logarithms of what is left of a ray, summed over the hits of all rays: float64 keeps the digits of single rays.
    left = torch.cat([lists.alpha.new_zeros(1, dtype=torch.float64), torch.log1p(-lists.alpha.double()).cumsum(0)])
    transmittance = (left[end] - left[begin]).exp()
    drawn = left[begin] + torch.log1p(-uniform(len(begin)).double() * (1 - transmittance))
    hit = torch.searchsorted(-left[1:], -drawn, right=True)
    hit = torch.minimum(torch.maximum(hit, begin), end - 1).clamp(min=0)
    solid = transmittance < TRACE_TRANSMITTANCE_STOP
    nothing = lists.surfel.new_zeros(1)
    surfel = torch.cat([lists.surfel, nothing])[torch.where(end > begin, hit, len(lists.surfel))]
    order = lists.ray.long()
    values = (
        torch.where(solid, 0.0, transmittance).to(lists.alpha),
        torch.where(solid, 1.0, 1 - transmittance).to(lists.alpha),
        surfel.long(),
    )
    return Met(*(torch.empty_like(value).index_copy_(0, order, value) for value in values))
