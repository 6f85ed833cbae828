"""A model under its own light shows a sun that is narrower than the distance of a surfel's spread directions."""

import pytest
import torch

from radiogs.model import Model
from radiogs.settings import Variant
from radiogs.showing import DENSER, Renderer
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.scene.light import EnvironmentMap, texel_directions, texel_solid_angles
from radiogs_core.transport.incident import Incident
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import Sphere
from scenes import surfels_over

ROWS = 16
SAMPLES = 32
BALL = Sphere((0.0, 0.0, 0.0), 1.0, Material((0.7, 0.7, 0.7), 0.9))


def sun() -> torch.Tensor:
    """A sun 45 degrees high and 40 times as bright as the sky, with half its radiance 9 degrees from its middle."""
    middle = torch.tensor([0.5**0.5, 0.0, 0.5**0.5], dtype=torch.float64)
    lobe = (60.0 * (texel_directions(ROWS, 2 * ROWS) @ middle - 1)).exp()
    return (0.5 + 20 * lobe)[..., None].expand(-1, -1, 3).float()


def by_quadrature(normal: torch.Tensor) -> torch.Tensor:
    """Irradiance on unoccluded surfaces, by a sum of the bilinear map over texels eight times as fine."""
    towards = texel_directions(8 * ROWS, 16 * ROWS)
    light = EnvironmentMap(sun().double()).lookup(towards)[..., 0] * texel_solid_angles(8 * ROWS, 16 * ROWS)
    return (normal.double() @ towards.flatten(0, 1).T).clamp(min=0) @ light.flatten()


def by_directions(normal: torch.Tensor, incident: Incident) -> torch.Tensor:
    """Irradiance from a renderer's directions, weights and visibility."""
    light = EnvironmentMap(sun()).lookup(incident.direction)[..., 0]
    cosine = (incident.direction * normal[:, None]).sum(-1).clamp(min=0)
    return (incident.weight * incident.visibility * cosine * light).sum(1).double()


def errors(deviations: tuple[str, ...]) -> tuple[float, float]:
    """Root-mean-square and mean of the relative error of irradiance, on the sunlit side."""
    surfels = surfels_over([BALL], 0.12)
    renderer = Renderer(Model(surfels, sun().log()), SAMPLES, Variant(deviations=deviations))
    assert renderer.incident is not None
    normal = surfels.frame[..., 2]
    truth = by_quadrature(normal)
    lit = truth > 0.5 * truth.max()
    relative = (by_directions(normal, renderer.incident) / truth - 1)[lit]
    return float(relative.square().mean().sqrt()), float(relative.mean())


def test_drawn_directions_remove_the_scatter_of_a_suns_irradiance() -> None:
    use_threads(1)
    scatter, bias = errors(())
    assert scatter < 0.04
    assert abs(bias) < 0.005
    assert errors(("spread-views",))[0] > 3 * scatter


def test_two_renderers_of_one_model_have_the_same_directions() -> None:
    model = Model(surfels_over([BALL], 0.3), sun().log())
    first, second = (Renderer(model, SAMPLES, Variant()).incident for _ in range(2))
    assert torch.equal(first.direction, second.direction)


@pytest.mark.parametrize("directions", [1, 3])
def test_the_number_of_drawn_directions_equals_that_of_spread_ones(directions: int) -> None:
    model = Model(surfels_over([BALL], 0.5), sun().log())
    for deviations, count in (((), 2 * DENSER * directions), (("spread-views",), directions)):
        incident = Renderer(model, directions, Variant(deviations=deviations)).incident
        assert incident.direction.shape[1] == count
