"""Both stages of TensoIR: losses, schedule, and resuming bit for bit."""

from dataclasses import replace
from typing import Any

import pytest
import torch

from baselines.methods.adapters import assert_resumes
from baselines.methods.tensoir.world import BUDGET, run_of
from known_ball import CPU, SCENE
from radiogs_baselines.methods.tensoir.box import box_of, cell_centres
from radiogs_baselines.methods.tensoir.drawing import RayBatch
from radiogs_baselines.methods.tensoir.marching import Rays
from radiogs_baselines.methods.tensoir.method import TENSOIR_METHOD
from radiogs_baselines.methods.tensoir.model import LIGHT
from radiogs_baselines.methods.tensoir.settings import InverseWeights, Learning, Schedule, Variant
from radiogs_baselines.methods.tensoir.training import InverseRendering, Optimiser, RadianceField
from radiogs_core.errors import DataError
from radiogs_core.learning.views import load
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.scene import Scene, View


def field_product(steps: int = 3) -> dict[str, Any]:
    stage = RadianceField(run_of(), {})
    for _ in range(steps):
        stage.step()
    return stage.product()


def tensors_of(stage: RadianceField | InverseRendering) -> dict[str, torch.Tensor]:
    return {name: value.detach().clone() for name, value in stage.optimiser.tensors.items()}


@pytest.mark.slow
def test_the_radiance_field_learns_the_images() -> None:
    budget = replace(BUDGET, field_iterations=200, rays=128)
    stage = RadianceField(run_of(budget=budget), {})
    before = tensors_of(stage)
    losses = [stage.step()["radiance"] for _ in range(150)]
    assert sum(losses[-10:]) < 0.1 * sum(losses[:10])
    untouched = {name for name, value in tensors_of(stage).items() if torch.equal(value, before[name])}
    assert {name.partition("_")[0] for name in untouched} == {"brdf", "normal"}


def test_resuming_the_radiance_field_changes_no_bit() -> None:
    assert_resumes(lambda: RadianceField(run_of(), {}), at=3, steps=6)


@pytest.mark.parametrize("at", [3, 8])
def test_resuming_inverse_rendering_changes_no_bit_on_any_grid(at: int) -> None:
    """In 40 steps the grid becomes finer at 0, 6, 11 and 17, and cells are emptied at 0, 3, 6, 9, 11 and 14."""
    before = solid_product(where=0.0)
    whole = assert_resumes(lambda: InverseRendering(run_of(), before), at, steps=13)
    assert 0 < int(whole.box.occupied.sum()) < int(before["box"]["occupied"].sum())


def test_the_grid_becomes_finer_on_schedule_and_rates_restart() -> None:
    stage = InverseRendering(run_of(), field_product())
    sizes, since = [], []
    for _ in range(20):
        stage.step()
        sizes.append(stage.field.size)
        since.append(stage.optimiser.since)
    # Four times by the same factor from 12 to 16.
    assert sizes == [13] * 6 + [14] * 5 + [15] * 6 + [16] * 3
    assert since == [*range(1, 7), *range(1, 6), *range(1, 7), 1, 2, 3]


def test_rates_decay_to_their_end_over_both_stages() -> None:
    rates = Learning().rates
    optimiser = Optimiser({"density_line": torch.zeros(1), LIGHT: torch.zeros(1)}, rates, 3.0, 10)
    optimiser.since = 10
    for value in optimiser.tensors.values():
        value.grad = torch.ones(1)
    optimiser.step()
    # Adam's first step is the rate itself.
    torch.testing.assert_close(float(optimiser.tensors["density_line"].detach()), -0.1 * rates.grid, rtol=1e-4, atol=0)
    torch.testing.assert_close(float(optimiser.tensors[LIGHT].detach()), -0.1 * rates.network * 3, rtol=1e-4, atol=0)


def test_cells_without_density_are_emptied_and_stay_empty() -> None:
    stage = InverseRendering(run_of(), field_product())
    with torch.no_grad():
        stage.optimiser.tensors["density_plane"].fill_(-30.0)
        stage.optimiser.tensors["density_line"].fill_(1.0)
    assert bool(stage.box.occupied.any())
    stage.step()
    assert not stage.box.occupied.any()
    losses = stage.step()  # nothing left to march through: white
    assert losses["normal difference"] == losses["albedo smoothness"] == 0.0


@pytest.mark.parametrize(
    ("weight", "moved"),
    [
        ("radiance", {"density", "appearance", "basis", "radiance"}),
        ("shaded", {"density", "appearance", "basis", "brdf", "normal", "light"}),
        ("normal_difference", {"density", "appearance", "basis", "normal"}),
        ("albedo_smoothness", {"density", "appearance", "basis", "brdf"}),
        ("sparsity", {"density"}),
    ],
)
def test_each_loss_changes_the_parameters_it_depends_on(weight: str, moved: set[str]) -> None:
    none = dict.fromkeys(InverseWeights.__dataclass_fields__, 0.0)
    learning = Learning(inverse=InverseWeights(**(none | {weight: 1.0})), schedule=Schedule((), ()))
    stage = InverseRendering(run_of(Variant(learning=learning)), solid_product())
    before = tensors_of(stage)
    stage.step()
    after = tensors_of(stage)
    found = {name.partition("_")[0] for name in after if not torch.equal(after[name], before[name])}
    assert found == moved


def solid_product(where: float = -1.0) -> dict[str, Any]:
    """Product of stage 1 with a field that is dense where x > ``where``: every ray there ends at a surface."""
    product = field_product()
    parameters = {name: value.clone() for name, value in product["parameters"].items()}
    dense = torch.linspace(-1, 1, parameters["density_plane"].shape[1])[:, None] >= where
    parameters["density_plane"][0, :, :, 0] = torch.where(dense, 4.0, -0.5)
    parameters["density_line"][0, :, 0] = 3.0
    return product | {"parameters": parameters}


def test_radiance_is_display_values_in_stage_1_and_linear_in_stage_2() -> None:
    """A dense field of radiance 0.25 has no error if pixels show 0.25; in stage 2, if they show its sRGB value."""
    parameters = dict(solid_product()["parameters"])
    parameters["radiance_weight_2"] = torch.zeros_like(parameters["radiance_weight_2"])
    parameters["radiance_bias_2"] = torch.logit(torch.full((3,), 0.25))
    encoded = float(srgb_encode(torch.tensor(0.25)))
    for linear, expected in (("later", 0.25), ("from-start", encoded)):
        stage = RadianceField(run_of(Variant(linear=linear)), {})
        stage.begin(stage.box, parameters)
        assert radiance_loss(stage, expected) < 1e-6
    later = InverseRendering(run_of(), field_product() | {"parameters": parameters})
    assert radiance_loss(later, encoded) < 1e-6
    assert radiance_loss(later, 0.25) > 1e-2


def radiance_loss(stage: RadianceField | InverseRendering, shown: float) -> float:
    """Radiance loss of rays through the middle of the box to pixels of one value."""
    towards = torch.nn.functional.normalize(torch.randn(20, 3, generator=torch.Generator().manual_seed(0)), dim=-1)
    batch = RayBatch(Rays(-3 * towards, towards), torch.full((20, 3), shown), torch.zeros(20, 1))
    return float(stage.losses(batch)["radiance"].detach())


def test_the_variant_switches_off_indirect_light_and_visibility() -> None:
    shaded = {}
    for name, variant in (
        ("full", Variant()), ("no indirect", Variant(indirect=False)), ("no visibility", Variant(visibility=False)),
        ("neither", Variant(indirect=False, visibility=False)),
    ):  # fmt: skip
        stage = InverseRendering(run_of(variant), solid_product())
        shaded[name] = stage.step()["shaded"]
    assert len(set(shaded.values())) == 4


def test_the_box_fits_the_ball_closely() -> None:
    box = box_of(SCENE, load(SCENE.train, CPU), 24)
    assert 1.0 < box.radius < 1.5
    position = box.centre + box.radius * cell_centres(24)
    inside = position.norm(dim=-1) < 1.0
    occupied = box.holds(box.local(position))
    assert torch.equal(occupied, box.occupied.flatten())
    assert bool(occupied[inside].all()), "what the ball fills is never empty"
    assert not occupied.all()
    assert not box.holds(torch.tensor([[1.01, 0.0, 0.0], [0.0, -1.01, 0.0]])).any()


def test_contradictory_silhouettes_are_refused() -> None:
    def blank(view: View) -> View:
        return View(view.name, view.camera, {**view.sources, "alpha": lambda: torch.zeros_like(view.read("alpha"))})

    scene: Scene = replace(SCENE, train=tuple(map(blank, SCENE.train)))
    with pytest.raises(DataError, match="silhouettes"):
        box_of(scene, load(scene.train, CPU), 16)


def test_training_reads_no_field_outside_its_key() -> None:
    field, invert = TENSOIR_METHOD.stages(Variant(), BUDGET)
    shown = Variant(shown="shaded", relight_visibility=False)
    less = replace(BUDGET, relight_samples=1)
    assert [stage.reads for stage in TENSOIR_METHOD.stages(shown, less)] == [field.reads, invert.reads]
    later = Variant(indirect=False, normals="derived", learning=Learning(inverse=InverseWeights(shaded=1.0)))
    more = replace(BUDGET, grid_end=20, lobes=3, light_rows=5, secondary_samples=9)
    other_field, other_invert = TENSOIR_METHOD.stages(later, more)
    assert other_field.reads == field.reads
    assert other_invert.reads != invert.reads
    mine, yours = RadianceField(run_of(), {}), RadianceField(run_of(later, more), {})
    for _ in range(3):
        assert mine.step() == yours.step()
    for changed in (Variant(linear="from-start"), Variant(view_share=0.5)):
        assert TENSOIR_METHOD.stages(changed, BUDGET)[0].reads != field.reads


def test_random_backgrounds_distinguish_white_from_empty() -> None:
    """Uncovered pixels show the drawn background; a white background is always white."""
    first = RadianceField(run_of(), {})
    random = InverseRendering(run_of(), first.product())
    white = InverseRendering(run_of(Variant(background="white")), first.product())
    for stage, one in ((first, True), (white, True), (random, False)):
        batch = stage.next_batch()
        outside = batch.target[(batch.target == batch.background).all(-1)]
        assert len(outside) > 20
        assert bool((outside == 1).all()) == one
        assert (len(outside.unique()) == 1) == one
