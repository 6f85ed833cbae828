"""Pixels that are left out change nothing that is learnt, whatever the photo or the model shows there."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import pytest
import torch

from radiogs_baselines.methods.tensoir.box import Box
from radiogs_baselines.methods.tensoir.drawing import ray_batch
from radiogs_baselines.methods.tensoir.settings import PRESETS
from radiogs_bench.methods import method as installed_method
from radiogs_core.contract import Run
from radiogs_core.kernels.image.terms import Aim, Blended, Compared, Terms, image_terms
from radiogs_core.learning.losses import counted
from radiogs_core.learning.views import TrainingView, in_memory, load
from radiogs_core.scene.scene import Scene, View
from radiogs_core.surfels.starting_points import Sightings, Silhouette
from radiogs_core.surfels.surroundings import SurroundingsStart, points_on_rays
from scenes import sphere_scene
from short_training import CPU

SIZE = 24


def hole(number: int) -> torch.Tensor:
    """Where a view counts: everywhere except in its own rectangle."""
    valid = torch.ones(SIZE, SIZE, 1)
    valid[6 + number % 3 : 14, 4 + 2 * (number % 4) : 16] = 0
    return valid


def scene_of(content: float, masked: bool = True) -> Scene:
    """A ball in front of a wall, with a hole in each view that holds ``content``; ``masked``: with coverage."""

    def view(number: int, seen: View) -> View:
        image, alpha, valid = seen.read("image"), seen.read("alpha"), hole(number)
        wall = torch.full_like(image, 0.3) * (1 - alpha) + image * alpha
        shown = torch.where(valid > 0, image if masked else wall, content)
        sources: dict[str, Callable[[], torch.Tensor]] = {"image": lambda: shown, "valid": lambda: valid}
        return replace(seen, sources=sources | ({"alpha": lambda: alpha} if masked else {}))

    scene = sphere_scene(views=6, size=SIZE)
    views = tuple(view(number, each) for number, each in enumerate(scene.train))
    return replace(scene, train=views, test=views[:2])


def begun(name: str, scene: Scene, steps: int, last: Scene | None = None) -> Any:
    """The last stage of a method, after ``steps`` steps of each earlier stage; it begins on the ``last`` scene."""
    method = installed_method(name)
    run = Run(scene, method.variant(), method.presets["smoke"], 0, CPU)
    product: Mapping[str, Any] = {}
    *before, final = method.stages(run.variant, run.budget)
    for spec in before:
        stage = spec.begin(run, product)
        for _ in range(steps):
            stage.step()
        product = stage.product()
    return final.begin(run if last is None else replace(run, scene=last), product)


def tensors_in(value: object) -> list[torch.Tensor]:
    if isinstance(value, torch.Tensor):
        return [value]
    parts = value.values() if isinstance(value, Mapping) else value if isinstance(value, list | tuple) else ()
    return [tensor for part in parts for tensor in tensors_in(part)]


@pytest.mark.slow
@pytest.mark.parametrize("masked", [False, True])
def test_radiogs_learns_nothing_from_pixels_left_out(masked: bool) -> None:
    models = []
    for content in (0.0, 0.9):
        stage = begun("radiogs", scene_of(content, masked), 2)
        stage.step()
        models.append(tensors_in(stage.product()))
    assert len(models[0]) == len(models[1]) > 0
    assert all(torch.equal(*pair) for pair in zip(*models, strict=True))


COMPARED_WITH_PHOTOS = ("shaded", "radiance")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["radiogs", "gi-gs", "gs-ir", "irgs", "r3dg", "svg-ir"])
def test_no_loss_compares_pixels_left_out_with_black(name: str) -> None:
    """Where only a corner counts that shows nothing, models fit, whatever they show elsewhere."""
    scene = sphere_scene(views=6, size=SIZE)
    corner = torch.zeros(SIZE, SIZE, 1)
    corner[:2, :2] = 1
    views = tuple(replace(view, sources={**view.sources, "valid": lambda: corner}) for view in scene.train)
    stage = begun(name, scene, 3, replace(scene, train=views))
    with torch.no_grad():
        plain = stage.losses(load(scene.train, CPU)[0].decoded())
        found = stage.losses(load(views, CPU)[0].decoded())
    compared = [each for each in COMPARED_WITH_PHOTOS if each in plain]
    assert compared
    for each in compared:
        assert float(plain[each]) > 1e-4, each
        assert abs(float(found[each])) < 1e-3 * float(plain[each]), each


def test_rays_of_tensoir_go_through_pixels_that_count() -> None:
    scene = scene_of(0.9, masked=False)
    views, generator = load(scene.train, CPU), torch.Generator().manual_seed(0)
    box = Box(torch.zeros(3), 2.0, torch.ones(2, 2, 2, dtype=torch.bool))
    batch = ray_batch(views, box, replace(PRESETS["smoke"], rays=600), (0, 0), generator, False)
    assert float((batch.target - 0.9).abs().sum(-1).min()) > 0


def aimed(background: float, valid: torch.Tensor | None) -> tuple[dict[str, torch.Tensor], list[torch.Tensor]]:
    """Losses of random blended images, and the gradients of their sum to the images and to coverage."""
    generator = torch.Generator().manual_seed(5)
    view = sphere_scene(views=2, size=SIZE).train[0]
    images = [torch.rand(SIZE, SIZE, 3, generator=generator).requires_grad_() for _ in range(2)]
    alpha = torch.rand(SIZE, SIZE, generator=generator).clamp(0.1, 0.9).requires_grad_()
    rest = Blended(alpha, torch.zeros(SIZE, SIZE, 3), torch.ones(SIZE, SIZE), torch.zeros(SIZE, SIZE))
    training = TrainingView(view.camera, view, in_memory(view.read("image"), CPU), None, valid=valid)
    compared = tuple(Compared(name, 0.8, 0.2) for name in ("first", "second"))
    terms = Terms(compared, "straight", background, 0.1, 0.0, False, 0.0, 0.0)
    aim = Aim(training.over(background), training.mask, None)
    losses = image_terms(terms, view.camera, *counted(training, background, aim, rest, images))
    torch.stack([*losses.values()]).sum().backward()
    return losses, [grad for each in (*images, alpha) if (grad := each.grad) is not None]


@pytest.mark.parametrize("background", [0.0, 1.0])
def test_losses_have_no_gradient_where_pixels_are_left_out(background: float) -> None:
    valid = hole(1)[..., 0] > 0
    _, gradients = aimed(background, valid)
    assert len(gradients) == 3
    for gradient in gradients:
        assert float(gradient[~valid].abs().max()) == 0
        assert float(gradient[valid].abs().max()) > 0
    all_count, without = aimed(background, torch.ones(SIZE, SIZE, dtype=torch.bool)), aimed(background, None)
    for one, other in zip(all_count[1], without[1], strict=True):
        torch.testing.assert_close(one, other, atol=1e-9, rtol=1e-5)


def test_starting_points_come_from_pixels_that_count() -> None:
    """Rays start at pixels that count, and their colours are compared with pixels that count."""
    scenes = [scene_of(content, masked=False) for content in (0.0, 0.9)]
    found = [
        points_on_rays(scene, scene.train, 200, SurroundingsStart(), torch.Generator().manual_seed(1))
        for scene in scenes
    ]
    assert torch.equal(found[0].positions, found[1].positions)
    assert torch.equal(found[0].colours, found[1].colours)
    assert float((found[1].colours - 0.9).abs().sum(-1).min()) > 0


def test_excluded_pixels_are_neither_inside_nor_outside_a_silhouette() -> None:
    view = scene_of(0.9).train[0]
    silhouette, points = Silhouette.of(view), 2 * torch.rand(500, 3, generator=torch.Generator().manual_seed(2)) - 1
    pixel, _, in_frame = view.camera.project(points)
    in_frame, on_object = silhouette.shows(pixel, in_frame)
    column, row = pixel.long().clamp(0, SIZE - 1).unbind(-1)
    left_out = view.read("valid")[row, column, 0] == 0
    assert bool(left_out.any())
    assert not bool((in_frame | on_object)[left_out].any())
    sightings = [Sightings.none(len(points)) for _ in range(2)]
    for each, content in zip(sightings, (0.0, 0.9), strict=True):
        each.add(points, scene_of(content).train[0], silhouette)
    assert torch.equal(sightings[0].total, sightings[1].total)


def test_views_without_such_a_map_are_as_before() -> None:
    view = load(sphere_scene(views=2, size=SIZE).train, CPU)[0]
    image = view.image
    assert view.valid is None
    assert view.where_valid(image) is image
    assert not view.reread().has("valid")
