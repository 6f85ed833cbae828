"""The measurement of which quantities images determine, on models with a known answer: balls and an open box."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache

import pytest
import torch

from known_ball import CPU
from radiogs.model import Model
from radiogs.nuisance import Answer
from radiogs.settings import PRESETS, Variant
from radiogs.showing import TrainedRadioGS
from radiogs_bench.scoring.what_images_determine import HALF_A_LEVEL, determined
from radiogs_bench.store.schema import Determined
from radiogs_core.capabilities import QUANTITIES, Nuisance, Part, Variable, Varying
from radiogs_core.contract import Run
from radiogs_core.errors import UsageError
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import texel_directions
from radiogs_core.scene.scene import View
from radiogs_core.surfels.surfels import Surfels, radiance_to_sh, roughness_to_logit
from radiogs_core.transport.plan import EffectPlan
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import Sphere
from scenes import look_at, sphere_scene, surfels_of_room, surfels_over

SIZE, VIEWS = 32, 6
BUDGET = replace(PRESETS["smoke"], incident_samples=128)
DULL, SHINY = 0.9, 0.3
CONSTANT = torch.ones(16, 32, 3)


def ball(roughness: float) -> Surfels:
    return surfels_over([Sphere((0.0, 0.0, 0.0), 1.0, Material((0.4, 0.3, 0.2), roughness))], 0.12)


def half_shiny() -> Surfels:
    """A ball whose upper half is shiny and whose lower half is dull."""
    surfels = ball(DULL)
    shiny = torch.tensor(roughness_to_logit(SHINY))
    return replace(surfels, roughness_logit=torch.where(surfels.centre[:, 2] > 0, shiny, surfels.roughness_logit))


def open_box() -> Surfels:
    """The inside of a cube without its lid; every wall has an outgoing radiance of 0.4."""
    room = surfels_of_room(1.0, 0.12, 0.6)
    box = room.take(torch.nonzero(room.centre[:, 2] < 0.95)[:, 0])
    box = box.with_material(0.6, DULL)
    box.sh[:, 0] = radiance_to_sh(torch.full((1, 3), 0.4))
    return box


def sunny() -> torch.Tensor:
    """A dim sky with a sun 30 degrees wide, so that some of 128 directions hit it."""
    towards = torch.nn.functional.normalize(torch.tensor([1.0, 0.3, 0.8]), dim=0)
    disc = (texel_directions(16, 32) @ towards.double() > 0.966).float()
    return (0.2 + 8 * disc)[..., None].repeat(1, 1, 3)


def around() -> list[Camera]:
    return [view.camera for view in sphere_scene(VIEWS, SIZE).train]


def within() -> list[Camera]:
    """Cameras in the middle of the box, which look at different parts of its walls and floor."""
    turns = torch.arange(VIEWS) * (2 * torch.pi / VIEWS)
    targets = torch.stack([turns.cos(), turns.sin(), torch.full_like(turns, -0.4)], -1)
    return [look_at(torch.zeros(3), target, SIZE, 0.6 * SIZE) for target in targets]


CASES: Mapping[str, tuple[Callable[[], Surfels], Callable[[], torch.Tensor], Callable[[], list[Camera]]]] = {
    "matte ball, constant light": (lambda: ball(DULL), lambda: CONSTANT, around),
    "glossy ball, sun": (lambda: ball(SHINY), sunny, around),
    "half shiny ball, sun": (half_shiny, sunny, around),
    "open box, constant light": (open_box, lambda: CONSTANT, within),
}


@cache
def trained(case: str, *given: Part) -> TrainedRadioGS:
    """The model of a case, with 8-bit images of itself as training images."""
    surfels, light, cameras = CASES[case]
    model = Model(surfels(), light().log())
    run = Run(sphere_scene(1, SIZE), Variant(given=given), BUDGET, 0, CPU)
    prepared = TrainedRadioGS(model, run).prepare()
    views = []
    for index, camera in enumerate(cameras()):
        image = (prepared.render(camera)["image"] * 255).round() / 255
        views.append(View(f"view_{index}", camera, {"image": lambda image=image: image}))
    return TrainedRadioGS(model, replace(run, scene=replace(run.scene, train=tuple(views))))


@cache
def found(case: str) -> dict[str, Determined]:
    model = trained(case)
    return determined(model, model.run.scene, CPU, "radiogs")


@pytest.mark.parametrize(
    ("case", "quantity", "expected"),
    [
        ("matte ball, constant light", "roughness", False),
        ("matte ball, constant light", "brightness", False),
        ("glossy ball, sun", "roughness", True),
        ("glossy ball, sun", "brightness", True),  # by the highlight: F0 is known
        ("half shiny ball, sun", "roughness variation", True),
        ("glossy ball, sun", "roughness variation", False),  # there is none
        ("open box, constant light", "brightness", True),  # by the walls' light on each other
        ("open box, constant light", "brightness, albedo free", False),  # the walls' albedo could hide it
        ("glossy ball, sun", "brightness, albedo free", False),  # light, normals and roughness can hide it
        ("open box, constant light", "roughness", False),
    ],
)
def test_determined_quantities_are_distinguished_from_undetermined_ones(
    case: str, quantity: str, expected: bool
) -> None:
    record = found(case)[quantity]
    assert record["determined"] is expected, record
    margin = record["rise_free"] / HALF_A_LEVEL
    assert margin > 1.5 if expected else margin < 1, "too near the threshold to be a test"


def test_the_free_rise_is_at_most_the_rise_with_free_albedo() -> None:
    for case in ("glossy ball, sun", "half shiny ball, sun", "open box, constant light"):
        for quantity, record in found(case).items():
            assert record["rise_free"] <= record["rise"], (case, quantity)
    hidden = found("glossy ball, sun")["brightness, albedo free"]
    assert hidden["rise"] > 1.5 * HALF_A_LEVEL > 1.5 * hidden["rise_free"]


def nuisance(quantity: str) -> Nuisance:
    model = trained("half shiny ball, sun")
    return model.varying([view.camera for view in model.run.scene.train][:2]).nuisance(quantity)


PARTS_OF_ANSWERS = {
    "roughness": ("albedo", "slope", "light"),
    "roughness variation": ("albedo", "roughness", "slope", "light"),
    "brightness": ("roughness", "slope", "light"),
    "brightness, albedo free": ("albedo", "roughness", "slope", "light"),
}


def single(of: Nuisance, part: str) -> torch.Tensor:
    """A small answer of one part alone: 0.05 units everywhere."""
    seen = len(of.jacobian.seen)  # type: ignore[attr-defined]
    answer = Answer.of(of.like, seen)
    return answer._replace(**{part: torch.full_like(getattr(answer, part), 0.05)}).flat()


@pytest.mark.parametrize("part", ["albedo", "roughness", "slope", "light"])
def test_the_jacobian_agrees_with_rendered_images(part: str) -> None:
    of = nuisance("brightness" if part == "light" else "roughness variation")
    answer = single(of, part)
    here = torch.stack(of.images(0.0, of.like))
    rendered = torch.stack(of.images(0.0, answer)) - here
    linear = torch.stack(of.change(answer))
    assert float(rendered.norm()) > 0.005, "the part answers"
    assert float((rendered - linear).norm()) < 0.15 * float(rendered.norm())


def test_pull_is_the_transpose_of_change() -> None:
    of = nuisance("brightness, albedo free")
    generator = torch.Generator().manual_seed(0)
    answer = torch.randn(of.like.shape, generator=generator)
    images = [torch.randn(SIZE, SIZE, 3, generator=generator) for _ in range(2)]
    forth = sum(float((one * other).double().sum()) for one, other in zip(of.change(answer), images, strict=True))
    back = float((of.pull(images) * answer).double().sum())
    assert forth == pytest.approx(back, rel=1e-3)


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_everything_that_was_learnt_may_answer_but_the_quantity_itself(quantity: str) -> None:
    of = nuisance(quantity)
    for part in ("albedo", "roughness", "slope", "light"):
        changes = float(torch.stack(of.change(single(of, part))).norm()) > 1e-6
        assert changes is (part in PARTS_OF_ANSWERS[quantity]), part


def test_light_cannot_answer_a_change_of_its_own_brightness() -> None:
    """A light that is everywhere as much brighter would undo it."""
    free, held = nuisance("brightness"), nuisance("brightness, albedo free")
    undone, left = (float(torch.stack(of.change(single(of, "light"))).mean()) for of in (free, held))
    assert abs(left) < 0.3 * undone


def test_given_parts_do_not_answer() -> None:
    model = trained("half shiny ball, sun", "light", "geometry")
    of = model.varying([view.camera for view in model.run.scene.train][:2]).nuisance("roughness")
    assert float(torch.stack(of.change(single(of, "light"))).norm()) == 0
    assert float(torch.stack(of.change(single(of, "slope"))).norm()) == 0


def test_values_are_means_over_visible_surfels() -> None:
    values = {name: record["value"] for name, record in found("half shiny ball, sun").items()}
    assert tuple(values) == QUANTITIES
    # The cameras are a little above the equator and see more of the upper half.
    assert SHINY < values["roughness"] < (SHINY + DULL) / 2
    assert values["roughness variation"] == pytest.approx((DULL - SHINY) / 2, rel=0.1)
    # A cap of half angle 15 degrees is 1.7 % of the sphere; its texels, some more or less.
    assert values["brightness"] == pytest.approx(0.2 + 8 * 0.017, abs=0.01)


def test_without_a_change_the_images_equal_those_of_evaluation() -> None:
    for case in CASES:
        model = trained(case)
        cameras = [view.camera for view in model.run.scene.train]
        prepared, varying = model.prepare(), model.varying(cameras)
        for quantity in QUANTITIES:
            for camera, image in zip(cameras, varying.images(quantity, 0.0), strict=True):
                torch.testing.assert_close(image, prepared.render(camera)["image"], atol=2e-5, rtol=0)


def test_images_without_lobes_equal_the_evaluations() -> None:
    """The diffuse part includes the energy of the missing lobe, which does not grow with albedo."""
    plan = replace(EffectPlan(), specular=False)
    run = Run(sphere_scene(1, SIZE), Variant(), BUDGET, 0, CPU)
    model = TrainedRadioGS(Model(ball(SHINY), sunny().log(), plan), run)
    (camera, *_), prepared = around(), model.prepare()
    (image,) = model.varying([camera]).images("roughness", 0.0)
    torch.testing.assert_close(image, prepared.render(camera)["image"], atol=2e-5, rtol=0)


def test_albedo_compensates_a_change_of_roughness() -> None:
    """In constant light a lobe differs little between views, so that albedo hides a change of roughness."""
    model = trained("matte ball, constant light")
    varying = model.varying([view.camera for view in model.run.scene.train])
    bare = model.varying([view.camera for view in model.run.scene.train])
    bare.weight = torch.zeros_like(bare.weight)  # no camera sees a surfel: albedo compensates nothing
    here = torch.stack(varying.images("roughness", 0.0))

    def change(of: Varying) -> float:
        return float((torch.stack(of.images("roughness", -0.4)) - here).square().mean())

    assert change(varying) < 0.2 * change(bare)


def test_albedo_is_limited_to_one() -> None:
    model = trained("matte ball, constant light")
    varying = model.varying([view.camera for view in model.run.scene.train])
    by_three = torch.stack(varying.images("brightness", 1.0986))
    assert float(by_three[..., 0].mean()) < 0.95 * float(torch.stack(varying.images("brightness", 0.0))[..., 0].mean())


@pytest.mark.parametrize(
    ("given", "free"),
    [((), QUANTITIES), (("roughness",), QUANTITIES[2:]), (("light",), QUANTITIES[:2]),
     (("albedo", "roughness"), ())],
)  # fmt: skip
def test_given_quantities_are_not_determined_from_images(given: tuple[Part, ...], free: tuple[str, ...]) -> None:
    model = trained("matte ball, constant light", *given)
    assert tuple(determined(model, model.run.scene, CPU, "radiogs")) == free
    for quantity in set(QUANTITIES) - set(free):
        with pytest.raises(UsageError, match=quantity):
            model.varying(around()).images(quantity, 0.1)


def test_quantities_are_measured_with_split_sum_shading_too() -> None:
    run = Run(sphere_scene(1, SIZE), Variant(shading="split-sum"), BUDGET, 0, CPU)
    model = TrainedRadioGS(Model(ball(SHINY), sunny().log()), run)
    assert isinstance(model, Variable)
    cameras = around()
    varying = model.varying(cameras)
    assert isinstance(varying, Varying)
    torch.testing.assert_close(
        varying.images("brightness", 0.0)[2], model.prepare().render(cameras[2])["image"], atol=2e-5, rtol=0
    )
    of = varying.nuisance("roughness")
    assert len(of.jacobian.seen) * 6 == len(of.like), "the light is held"
    changed = varying.images("roughness", 0.2)[2] - varying.images("roughness", 0.0)[2]
    assert float(changed.square().mean()) > HALF_A_LEVEL
