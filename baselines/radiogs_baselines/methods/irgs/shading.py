"""Monte Carlo shading of surface points: L_o = sum_i w_i (a / pi + f_s) (V L_env + L_ind) (n.w_i)."""

from jaxtyping import Float
from torch import Tensor

from radiogs_core.on_surfels.seen_points import SeenPoints, Shaded
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.shading import shade_materials
from radiogs_core.transport.splatting import DIFFUSE_DIRECT, DIFFUSE_INDIRECT, SPECULAR_DIRECT, SPECULAR_INDIRECT


def shade_points(points: SeenPoints, incident: Incident, environment: Float[Tensor, "rows columns 3"]) -> Shaded:
    """Shade points under their incident light; zero where the camera is below the surface."""
    parts = shade_materials(
        points.normal, points.albedo, points.roughness, points.outgoing[:, None], incident, environment
    )[:, 0]
    return Shaded(
        parts[:, DIFFUSE_DIRECT] + parts[:, SPECULAR_DIRECT],
        parts[:, DIFFUSE_INDIRECT] + parts[:, SPECULAR_INDIRECT],
    )


def mean_direct_light(incident: Incident, environment: Float[Tensor, "rows columns 3"]) -> Float[Tensor, "points 3"]:
    """Mean over each point's hemisphere of V L_env, linear; the neutrality loss compares its channels."""
    arriving = incident.visibility[..., None] * EnvironmentMap(environment).lookup(incident.direction)
    return (arriving * incident.weight[..., None]).sum(1) / incident.weight.sum(1, keepdim=True)
