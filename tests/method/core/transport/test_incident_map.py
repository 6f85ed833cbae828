"""The maps of the light that arrives, indirect and direct."""

import torch

from radiogs_core.transport.incident import Incident
from radiogs_core.transport.maps import incident_maps
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
    environment = torch.full((2, 4, 3), 3.0)
    incident.visibility[:, 0] = 0.5  # the others are hidden
    found = incident_maps(camera, surfels, incident, environment)
    torch.testing.assert_close(found["incident"], alpha[..., None] * radiance)
    share = splat(camera, surfels, {"share": weight[:, :1] / weight.sum(1, keepdim=True)}, depth_unit=1.0).images[
        "share"
    ]
    torch.testing.assert_close(found["incident_direct"], (1.5 * share).expand_as(found["incident"]))
    # Directions that stand for no solid angle do not count.
    incident.weight[:, 1:] = 0
    incident.radiance = torch.cat([radiance.expand(4, 1, 3), torch.rand(4, 4, 3)], 1)
    found = incident_maps(camera, surfels, incident, environment)
    torch.testing.assert_close(found["incident"], alpha[..., None] * radiance)
    torch.testing.assert_close(found["incident_direct"], (1.5 * alpha)[..., None].expand_as(found["incident"]))
    incident.weight[:] = 0
    assert all(bool((image == 0).all()) for image in incident_maps(camera, surfels, incident, environment).values())
