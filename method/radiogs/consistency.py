"""Radiometric consistency: the surfels' own radiance L_G must satisfy the rendering equation (paper, Eq. 6-9).

    L_rad = mean over surfels x and channels of  sum over w_o of |L_G(x, w_o) - L_PBR(x, w_o)|
    L_PBR(x, w_o) = sum over w_i of  dw_i f_r(w_i, w_o) (V(w_i) L_env(w_i) + L_ind(w_i)) (n . w_i)

There are two w_o: the direction towards the camera, and one drawn uniformly over the hemisphere. w_i are the incident
directions, dw_i their solid angles; V and L_ind are traced through the surfels. In PyTorch, with ``outgoing`` [surfels,
2, 3] and ``direction`` [surfels, samples, 3] the unit vectors w_o and w_i, and ``specular`` of ``kernels.shade.brdf``:

    n, wo, wi = torch.broadcast_tensors(normal[:, None, None], outgoing[:, :, None], direction[:, None])
    cosine = (n * wi).sum(-1).clamp(min=0)
    arriving = visibility[..., None] * EnvironmentMap(environment).lookup(direction) + indirect
    lobe = albedo[:, None, None] / torch.pi + specular(n, wo, wi, roughness[:, None, None].expand_as(cosine))[..., None]
    physical = (weight[:, None, :, None] * cosine[..., None] * lobe * arriving[:, None]).sum(2)
    facing = (outgoing * normal[:, None]).sum(-1, keepdim=True) > 0
    loss = torch.where(facing, surfel_radiance(sh, outgoing) - physical, 0.0).abs().sum(1).mean()

The kernel does this in one pass over blocks of samples. ``arriving`` and ``cosine`` are in the sections ``block`` and
``look_up`` of ``kernels/shade/shade.inl``, ``specular`` and its sum in ``lobe`` and ``shade_block``, the Lambertian sum
in ``add_diffuse``; ``outgoing`` and ``loss`` are in ``sides`` and ``forward`` of ``consistency.inl``.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from radiogs_core.kernels.shade.consistency import consistency_of
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.prefiltered_light import PrefilteredLight, split_sum_radiance
from radiogs_core.transport.shading import lambert_albedo

from .settings import Variant


@dataclass(frozen=True)
class RadiometricConsistency:
    """L_rad with traced incident light (paper, Eq. 9)."""

    own_learns: bool = True
    """Whether the side L_G has gradient."""
    physical_learns: bool = True
    """Whether the side L_PBR has gradient."""
    light_learns: bool = True
    """Whether the light has gradient."""
    roughness_learns: bool = True
    """Whether roughness has gradient."""

    @classmethod
    def of(cls, variant: Variant) -> "RadiometricConsistency":
        """L_rad with the settings of a variant."""
        return cls(
            own_learns=variant.detach != "surfel",
            physical_learns=variant.detach != "pbr",
            light_learns="light-detached" not in variant.deviations,
            roughness_learns=variant.materials.consistent_roughness,
        )

    def loss(
        self,
        surfels: Surfels,
        environment: Float[Tensor, "height width 3"],
        camera: Camera,
        index: Int[Tensor, " chosen"],
        incident: Incident,
        generator: torch.Generator,
        specular_at: Bool[Tensor, " surfels"] | None = None,
    ) -> Float[Tensor, ""]:
        """L_rad over the surfels ``index``, from the light ``incident`` on them.

        Both outgoing directions of a surfel share its incident samples. The direction towards the camera counts only
        for surfels that face it. ``environment``: linear radiance of the light. ``specular_at``: mask over all surfels:
        True for surfels with a specular lobe (None: all have one).
        """
        roughness = surfels.roughness if self.roughness_learns else surfels.roughness.detach()
        drawn = torch.randn(len(index), 3, generator=generator, dtype=surfels.centre.dtype, device=index.device)
        return consistency_of(
            index, camera.centre, drawn, surfels.centre, surfels.sh, surfels.frame,
            lambert_albedo(surfels.albedo, roughness, specular_at), roughness,
            incident.direction, incident.weight, incident.visibility, incident.radiance,
            environment if self.light_learns else environment.detach(), specular_at,
            self.own_learns, self.physical_learns,
        )  # fmt: skip


def split_sum_consistency_loss(
    surfels: Surfels,
    own: Float[Tensor, "surfels 3"],
    light: PrefilteredLight,
    outgoing: Float[Tensor, "surfels 3"],
    normal_gradient: bool = True,
) -> tuple[Float[Tensor, ""], Float[Tensor, "surfels 3"]]:
    """The simplified L_rad of stage 1, over all surfels towards the camera, and the split-sum radiance, linear RGB.

    ``own``: L_G along the unit directions ``outgoing``. ``normal_gradient``: whether the loss and the radiance have
    gradient to the surfels' normals.
    """
    normal = surfels.frame[..., 2] if normal_gradient else surfels.frame[..., 2].detach()
    diffuse, specular = split_sum_radiance(normal, surfels.albedo, surfels.roughness, outgoing, light)
    physical = diffuse + specular
    facing = ((outgoing * normal).sum(-1) > 0)[:, None]
    residual = torch.where(facing, own - physical, 0.0)
    return residual.abs().mean(), physical
