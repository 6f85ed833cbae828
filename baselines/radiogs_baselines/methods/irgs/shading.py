"""Monte-Carlo shading of seen points: L_o = sum_i w_i (a / pi + f_s) (V L_env + L_ind) (n.w_i)."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from radiogs_core.on_surfels.seen_points import SeenPoints
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.shading import shade_materials
from radiogs_core.transport.splatting import DIFFUSE_DIRECT, DIFFUSE_INDIRECT, SPECULAR_DIRECT, SPECULAR_INDIRECT


@dataclass(frozen=True)
class Shaded:
    """Outgoing radiance of points towards the camera, linear: after one surface, and after more."""

    direct: Float[Tensor, "points 3"]
    indirect: Float[Tensor, "points 3"]

    @property
    def radiance(self) -> Float[Tensor, "points 3"]:
        """All of it."""
        return self.direct + self.indirect


def shade_points(points: SeenPoints, incident: Incident, environment: Float[Tensor, "rows columns 3"]) -> Shaded:
    """The points under their incident light; zero where the camera looks from below the surface."""
    parts = shade_materials(
        points.normal, points.albedo, points.roughness, points.outgoing[:, None], incident, environment
    )[:, 0]
    return Shaded(
        parts[:, DIFFUSE_DIRECT] + parts[:, SPECULAR_DIRECT],
        parts[:, DIFFUSE_INDIRECT] + parts[:, SPECULAR_INDIRECT],
    )


def mean_direct_light(incident: Incident, environment: Float[Tensor, "rows columns 3"]) -> Float[Tensor, "points 3"]:
    """Mean over each hemisphere of V L_env: what the light's neutrality is asked of."""
    arriving = incident.visibility[..., None] * EnvironmentMap(environment).lookup(incident.direction)
    return (arriving * incident.weight[..., None]).sum(1) / incident.weight.sum(1, keepdim=True)
