"""The map of the indirect light that arrives."""

import torch

from radiogs_core.transport.incident import Incident
from radiogs_core.transport.maps import incident_map
from radiogs_core.transport.splatting import splat
from scenes import sphere_scene, surfels_facing


def test_the_released_indirect_light_is_the_hemispheres_mean_splatted() -> None:
    """A constant radiance from everywhere is itself times coverage, whatever the weights."""
    camera = sphere_scene().test[0].camera
    surfels = surfels_facing(torch.zeros(4, 3), torch.nn.functional.normalize(camera.centre.expand(4, 3), dim=-1))
    weight = torch.rand(4, 5)
    direction = torch.nn.functional.normalize(torch.randn(4, 5, 3), dim=-1)
    radiance = torch.tensor([0.2, 0.4, 0.8])
    incident = Incident(direction, weight, torch.zeros(4, 5), radiance.expand(4, 5, 3))
    alpha = splat(camera, surfels, {"any": torch.zeros(4, 1)}, depth_unit=1.0).alpha
    assert alpha.max() > 0.5
    torch.testing.assert_close(incident_map(camera, surfels, incident), alpha[..., None] * radiance)
    # Directions that stand for no solid angle do not count.
    incident.weight[:, 1:] = 0
    incident.radiance = torch.cat([radiance.expand(4, 1, 3), torch.rand(4, 4, 3)], 1)
    torch.testing.assert_close(incident_map(camera, surfels, incident), alpha[..., None] * radiance)
