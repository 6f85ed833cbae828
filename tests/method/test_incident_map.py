"""The indirect light that arrives, as the released code writes it."""

from dataclasses import replace

import torch

from radiogs.budget import PRESETS
from radiogs.model import Model, constant_light
from radiogs.rendering import Renderer
from radiogs.variant import Variant
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.splatting import splat
from scenes import sphere_scene

CPU = torch.device("cpu")


def test_it_is_the_hemispheres_mean_splatted() -> None:
    """A constant radiance from everywhere is itself times coverage, whatever the weights."""
    camera, zeros = sphere_scene().test[0].camera, torch.zeros(4)
    colour = torch.zeros(4, 3)
    surfels = Surfels(colour, torch.ones(4, 4), torch.zeros(4, 2), zeros, torch.zeros(4, 16, 3), colour, zeros)
    model = Model(surfels, constant_light(2, 1.0, CPU))
    renderer = Renderer(model, PRESETS["smoke"].incident_samples, Variant())
    weight = torch.rand(4, 5)
    direction = torch.nn.functional.normalize(torch.randn(4, 5, 3), dim=-1)
    radiance = torch.tensor([0.2, 0.4, 0.8])
    renderer.incident = Incident(direction, weight, torch.zeros(4, 5), radiance.expand(4, 5, 3))
    alpha = splat(camera, surfels, {"any": torch.zeros(4, 1)}, depth_unit=1.0).alpha
    assert alpha.max() > 0.5
    torch.testing.assert_close(renderer.incident_map(camera), alpha[..., None] * radiance)
    # Directions that stand for no solid angle do not count.
    one = torch.cat([weight[:, :1], torch.zeros(4, 4)], 1)
    some = torch.cat([radiance.expand(4, 1, 3), torch.rand(4, 4, 3)], 1)
    renderer.incident = replace(renderer.incident, weight=one, radiance=some)
    torch.testing.assert_close(renderer.incident_map(camera), alpha[..., None] * radiance)
