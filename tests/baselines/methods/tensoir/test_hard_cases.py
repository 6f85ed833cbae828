"""Hard cases of ``hard_cases.catalogue`` for TensoIR; test names contain the number of the case."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from baselines.methods.adapters import assert_finite
from baselines.methods.tensoir.world import BUDGET, floor_field, grey, looking_down, made_of, model_of, run_of
from radiogs_baselines.methods.tensoir.drawing import camera_rays
from radiogs_baselines.methods.tensoir.field import Field
from radiogs_baselines.methods.tensoir.light import SphericalGaussians
from radiogs_baselines.methods.tensoir.marching import Rays, march
from radiogs_baselines.methods.tensoir.model import Model
from radiogs_baselines.methods.tensoir.settings import Variant
from radiogs_baselines.methods.tensoir.showing import TrainedTensoIR
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap

FLOOR = made_of(floor_field(top=-0.5), radiance=0.3, albedo=0.6, upward=True)
EMPTY_SPACE = made_of(floor_field(top=-3.0), radiance=0.3, albedo=0.6)


def shown(field: Field, camera: Camera, light: EnvironmentMap | None = None) -> dict[str, Tensor]:
    return dict(TrainedTensoIR(model_of(field), run_of(Variant(shown="shaded"))).prepare(light).render(camera))


@pytest.mark.parametrize("kind", ["no density", "no occupied cell"])
def test_case_21_empty_space_is_black(kind: str) -> None:
    field = EMPTY_SPACE
    if kind == "no occupied cell":
        field = Field(replace(FLOOR.box, occupied=torch.zeros_like(FLOOR.box.occupied)), FLOOR.parameters)
    for maps in (shown(field, looking_down()), shown(field, looking_down(), grey())):
        assert all(not value.any() for value in maps.values())
    for variant in (Variant(), Variant(shown="shaded")):
        own = TrainedTensoIR(model_of(field), run_of(variant)).prepare().render(looking_down())
        assert not own["image"].any()


@pytest.mark.parametrize("shape", [(1, 1), (17, 1), (1, 17), (33, 15)])
def test_case_22_images_of_any_shape(shape: tuple[int, int]) -> None:
    height, width = shape
    whole = looking_down()
    camera = Camera(whole.camera_to_world, 40.0, 40.0, width / 2, height / 2, width, height)
    maps = shown(FLOOR, camera)
    assert all(value.shape[:2] == shape for value in maps.values())
    assert_finite(maps)


@pytest.mark.parametrize("exponent", [-10, 10])
def test_case_19_the_world_may_have_any_scale(exponent: int) -> None:
    """All values are local to the box: powers of two change only the depth."""
    scale = 2.0**exponent
    camera = looking_down()
    matrix = camera.camera_to_world.clone()
    matrix[:3, 3] *= scale
    large = Field(replace(FLOOR.box, radius=scale), FLOOR.parameters)
    one, other = shown(FLOOR, camera), shown(large, replace(camera, camera_to_world=matrix))
    assert all(torch.equal(one[name], other[name]) for name in one if name != "depth")
    torch.testing.assert_close(other["depth"], scale * one["depth"])
    assert float(one["depth"][1, 1]) == pytest.approx(1.4, abs=0.03)


def test_a_camera_inside_the_box_sees_the_floor_in_front_of_it() -> None:
    """From 0.9, from just above the floor, and from inside it, where the first sample is solid."""
    for height in (0.9, -0.4):
        maps = shown(FLOOR, looking_down(height))
        assert_finite(maps)
        assert float(maps["depth"][1, 1]) == pytest.approx(height + 0.5, abs=0.03)
    maps = shown(FLOOR, looking_down(-0.7))
    assert_finite(maps)
    assert float(maps["alpha"][1, 1]) == pytest.approx(1.0)
    assert 0 < float(maps["depth"][1, 1]) < 0.05
    upwards = looking_down(-0.3)
    turned = upwards.camera_to_world.clone()
    turned[:3, :3] = torch.diag(torch.tensor([1.0, 1.0, 1.0]))
    assert not shown(FLOOR, replace(upwards, camera_to_world=turned))["alpha"].any()


def test_rays_along_the_axes_and_on_the_faces_of_the_box_are_marched() -> None:
    """Their directions have zero components, by which the intersection divides."""
    for origin, direction in (((0.0, 0.0, 3.0), (0.0, 0.0, -1.0)), ((1.0, 0.0, 3.0), (0.0, 0.0, -1.0))):
        marched = march(FLOOR, Rays(torch.tensor([origin]), torch.tensor([direction])))
        assert bool(torch.isfinite(marched.weight).all())
        assert bool(torch.isfinite(marched.distance).all())
        if origin[0] == 0.0:
            assert float(marched.alpha) == pytest.approx(1.0)
            assert float(marched.distance) == pytest.approx(3.5, abs=0.03)
    past = march(FLOOR, Rays(torch.tensor([[1.5, 0.0, 3.0]]), torch.tensor([[0.0, 0.0, -1.0]])))
    assert float(past.alpha) == 0.0


def test_case_33_a_black_recovered_light_gives_black() -> None:
    own = Model(FLOOR, SphericalGaussians(torch.zeros(3, 7)))
    maps = TrainedTensoIR(own, run_of(Variant(indirect=False))).prepare().render(looking_down())
    assert_finite(dict(maps))
    assert not maps["direct"].any()


def test_case_33_a_black_recovered_light_has_finite_gradients() -> None:
    raw = torch.zeros(3, 7, requires_grad=True)
    SphericalGaussians(raw).radiance(torch.tensor([[0.0, 0.0, 1.0]])).sum().backward()
    assert raw.grad is not None
    assert bool(torch.isfinite(raw.grad).all())


def test_case_40_blended_normals_that_cancel_receive_no_light() -> None:
    """The network predicts zero normals everywhere."""
    parameters = dict(FLOOR.parameters)
    parameters["normal_bias_2"] = torch.zeros_like(parameters["normal_bias_2"])
    maps = shown(Field(FLOOR.box, parameters), looking_down())
    assert_finite(maps)
    assert not maps["direct"].any()
    assert not maps["normal"].any()


def test_case_44_the_same_seed_gives_the_same_model() -> None:
    from radiogs_baselines.methods.tensoir.training import RadianceField

    def learnt() -> dict[str, Tensor]:
        stage = RadianceField(run_of(budget=BUDGET), {})
        for _ in range(3):
            stage.step()
        return stage.optimiser.plain()

    one, other = learnt(), learnt()
    assert all(torch.equal(one[name], other[name]) for name in one)


def test_rays_of_a_camera_are_of_unit_length_in_any_box() -> None:
    box = replace(FLOOR.box, radius=7.0, centre=torch.tensor([1.0, 2.0, 3.0]))
    rays = camera_rays(looking_down(), box)
    torch.testing.assert_close(rays.direction.norm(dim=-1), torch.ones(9))
    torch.testing.assert_close(rays.origin[0] * 7.0 + box.centre, torch.tensor([0.0, 0.0, 0.9]))
