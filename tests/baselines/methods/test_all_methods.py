"""Tests that all surfel methods share: hard cases of ``hard_cases.catalogue``, resuming, stage keys, wrong variants.

Tests of a single method are in its folder; ``test_contract`` tests the contract of every method.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest
import torch

from baselines.methods.adapters import ADAPTERS, RESUMED, Maps, assert_finite, assert_resumes, same
from baselines.methods.irgs.world import OPAQUE, grey, looking_down, sheet, together
from baselines.methods.stage_two import R3DG, STANDING, product_of, tensors_of
from baselines.methods.tensoir.world import looking_down as down_upon_a_field
from baselines.methods.trained_models import MODELS, r3dg
from hard_cases.constructions import ball_of_surfels, looking_along_z, moved, raw_surfels, two_balls
from known_ball import BALL
from radiogs_baselines.methods.tensoir.settings import Learning, Schedule
from radiogs_bench.methods import method
from radiogs_core.errors import UsageError
from radiogs_core.kernels.runtime import use_threads

METHODS = pytest.mark.parametrize("name", ADAPTERS)
FAR = torch.tensor([0.0, 0.0, 500.0])


@METHODS
@pytest.mark.parametrize("kind", ["none", "all behind", "one"])
def test_case_21_empty_and_nearly_empty_scenes_are_rendered(name: str, kind: str) -> None:
    surfels = raw_surfels(0 if kind == "none" else 5)
    if kind == "all behind":
        surfels.centre = surfels.centre - torch.tensor([0.0, 0.0, 20.0])
    if kind == "one":
        surfels = surfels.take(torch.tensor([0]))
    for maps in ADAPTERS[name].shown(surfels, looking_along_z(), 1.0):
        if kind == "one":
            assert_finite(maps)
            assert float(maps["image"].max()) > 0
            assert ADAPTERS[name].lights_itself or bool((maps["indirect"] == 0).all()), "a surfel does not see itself"
        else:
            assert all(bool((value == 0).all()) for value in maps.values())


@METHODS
def test_case_21_a_step_that_sees_no_surfel_changes_no_material(name: str) -> None:
    adapter = ADAPTERS[name]
    still = dict(adapter.learnt) | {"lr_scale": 0.0} if "lr_scale" in adapter.learnt else adapter.learnt
    away = replace(BALL, centre=BALL.centre + FAR)
    stage = adapter.training.stage_of(adapter.training.variant(**still, **adapter.seen_alone), away)
    before = tensors_of(stage)
    losses = stage.step()
    assert [losses[each] for each in adapter.silent] == [0.0] * len(adapter.silent)
    after = tensors_of(stage)
    assert_finite(after)
    lit = ("environment", "local") if name == "r3dg" else ("environment",)
    assert all(torch.equal(after[each], before[each]) for each in after if not any(word in each for word in lit))


@METHODS
@pytest.mark.parametrize("shape", [(1, 1), (17, 1), (1, 17), (33, 15)])
def test_case_22_images_of_any_shape(name: str, shape: tuple[int, int]) -> None:
    camera = looking_along_z(*shape)
    maps = ADAPTERS[name].shown(raw_surfels(30), camera, 1.0)[0]
    assert all(value.shape[:2] == (camera.height, camera.width) for value in maps.values())
    assert_finite(maps)


@METHODS
@pytest.mark.parametrize("exponent", [-10, 10])
def test_case_19_the_world_may_have_any_scale(name: str, exponent: int) -> None:
    """The method's lengths are scaled with the world. Powers of two round alike; the tolerance is for logarithms of
    scales, which do not, and for rays that graze an edge.
    """
    surfels, camera = two_balls(), looking_along_z(16, 12, 14.0)
    surfels.centre = surfels.centre + torch.tensor([0.0, 0.0, 5.0])
    large, its = moved(surfels, camera, 2.0**exponent)
    one, other = ADAPTERS[name].shown(surfels, camera, 1.0)[0], ADAPTERS[name].shown(large, its, 2.0**exponent)[0]
    most, share = ADAPTERS[name].tolerance
    for map_ in ("image", "albedo", "direct", "indirect"):
        off = (one[map_] - other[map_]).abs().amax(-1)
        assert float((off > most).double().mean()) < share, map_
    assert float(one["direct"].max()) > 0
    assert float(one["indirect"].max()) > 0


@METHODS
@pytest.mark.parametrize("cosine", [1e-1, 1e-2, 1e-4, 1e-6])
def test_case_26_a_floor_seen_at_grazing_angles(name: str, cosine: float) -> None:
    sine = (1 - cosine**2) ** 0.5
    floor = sheet(0.0, (sine, 0.0, cosine), scale=0.5, opacity=OPAQUE)
    for maps in ADAPTERS[name].shown(floor, looking_down(1.0, 9), 1.0):
        assert_finite(maps)
    training = ADAPTERS[name].training
    stage = training.stage_of(training.variant(**ADAPTERS[name].learnt), together(BALL, floor))
    for _ in range(3):
        stage.step()  # raises where a gradient is not finite


@pytest.mark.parametrize("name", MODELS)
def test_case_33_a_black_light_gives_black_and_a_sun_a_finite_image(name: str) -> None:
    """``test_contract`` tests the error for a broken texel."""
    camera = down_upon_a_field() if name == "tensoir" else looking_down(4.0, 9)
    model = r3dg(R3DG.variant(relight_local_light=False)) if name == "r3dg" else MODELS[name]()
    black = model.prepare(grey(0.0)).render(camera)
    assert bool(black["alpha"].any())
    assert not any(bool(black[each].any()) for each in ("image", "direct", "indirect"))
    sun = grey(0.0)
    sun.radiance[1, 3] = 1e5
    assert_finite(model.prepare(sun).render(camera))


@METHODS
def test_case_40_blended_normals_that_cancel_leave_finite_maps(name: str) -> None:
    """Two sheets of equal weight lean to opposite sides by nearly 90 degrees from the view."""
    lean = (1 - 1e-12) ** 0.5
    left = sheet(0.0, (lean, 0.0, 1e-6), scale=1.0, opacity=0.5)
    right = sheet(0.0, (-lean, 0.0, 1e-6), scale=1.0, opacity=OPAQUE)
    for maps in ADAPTERS[name].shown(together(left, right), looking_down(1.0, 5), 1.0):
        assert_finite(maps)


@METHODS
def test_case_44_the_same_seed_gives_the_same_model_on_any_number_of_threads(name: str) -> None:
    training = ADAPTERS[name].training
    surfels = together(BALL, ball_of_surfels())

    def learnt() -> Maps:
        stage = training.stage_of(training.variant(**ADAPTERS[name].learnt), surfels)
        for _ in range(3):
            stage.step()
        return tensors_of(stage)

    use_threads(1)
    alone, again = learnt(), learnt()
    assert same(alone, again)
    try:
        use_threads(3)
        first, second = learnt(), learnt()
    finally:
        use_threads(1)
    assert same(first, second)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "turned"),
    [
        ("gs-ir", {}), ("gs-ir", {"metallic": True, "lr_scale": 0.0}), ("gs-ir", {"occlusion": False}),
        ("gi-gs", {"thick": 0.1}), ("gi-gs", {"thick": 0.1, "metallic": True}),
        ("irgs", {"lr_scale": 0.0}), ("irgs", {"lr_scale": 0.5}),
        ("r3dg", {"visibility": "table"}), ("r3dg", {"visibility": "retraced"}), ("svg-ir", {"hop": None}),
    ],
)  # fmt: skip
def test_stage_two_resumes_bit_for_bit(name: str, turned: dict[str, Any]) -> None:
    """Includes the default search for the initial light."""
    training = ADAPTERS[name].training
    surfels = STANDING if name == "gi-gs" else RESUMED
    budget = training.budget
    if name == "svg-ir":
        budget = replace(budget, consistency_surfels=100)

    def begun() -> Any:
        run = training.run_of(method(name).variant(**turned), budget)
        return training.method.begin(run, product_of(surfels))

    assert_resumes(begun, at=3, steps=8)


SHOWN: Mapping[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "gs-ir": ({"frame": "as_shipped"}, {}),
    "gi-gs": ({"relight_indirect": False, "frame": "as_shipped"}, {"render_azimuths": 4, "render_heights": 3}),
    "irgs": (
        {"relight_indirect": False, "secondary_albedo": "scaled"},
        {"render_samples": 1, "relight_hemisphere_samples": 1, "relight_light_samples": 1},
    ),
    "r3dg": ({"relight_local_light": False}, {"relight_samples": 1}),
    "svg-ir": ({"relight_indirect": False, "relight_rows": 4}, {"relight_samples": 1}),
}
"""Fields of variant and budget that only affect rendering, with changed values."""

TRAINED: Mapping[str, list[dict[str, Any]]] = {
    "gs-ir": [
        {"occlusion": False}, {"indirect": False}, {"tau": None}, {"nearest": 0.01}, {"metallic": True},
        {"texel_areas": "approximate"}, {"masking": "schlick"}, {"lr_scale": 0.1},
    ],
    "gi-gs": [
        {"indirect": False}, {"readme_bug": True}, {"start": 4}, {"metallic": True}, {"far": 9.0},
        {"masking": "schlick"},
    ],
    "irgs": [{"indirect": "none"}, {"lr_scale": 0.1}, {"ray_start": 0.01}, {"two_sided": False}],
    "r3dg": [{"local_light": "gated"}, {"hidden_below": 0.5}, {"visibility": "retraced"}, {"floor": True}],
    "svg-ir": [{"hop": None}, {"attributes": "constant"}, {"ray_start": 0.01}, {"opaque": 0.1}],
}  # fmt: skip
"""Fields of the variant that training depends on, changed one by one."""

MORE: Mapping[str, tuple[str, ...]] = {
    "gs-ir": ("occlusion_corners", "occlusion_directions", "occlusion_samples", "irradiance_corners"),
    "gi-gs": ("azimuths",),
    "irgs": ("incident_samples", "pixels"),
    "r3dg": ("incident_samples",),
    "svg-ir": ("incident_samples", "consistency_surfels"),
}
"""Fields of the budget that training depends on."""


@METHODS
def test_training_reads_no_field_outside_its_key(name: str) -> None:
    """Fields for rendering change neither key nor losses; fields for training change the key."""
    ours, training = method(name), ADAPTERS[name].training
    geometry, invert = ours.stages(ours.variant(), training.budget)
    assert geometry.owner == "radiogs_core"
    turned, less = SHOWN[name]
    smaller = replace(training.budget, **less)
    assert ours.stages(ours.variant(**turned), smaller)[1].reads == invert.reads
    one = training.stage_of()
    other = training.stage_of(training.variant(**turned), budget=smaller)
    for _ in range(2):
        assert one.step() == other.step()
    for changes in TRAINED[name]:
        assert ours.stages(ours.variant(**changes), training.budget)[1].reads != invert.reads, changes
    for number in MORE[name]:
        more = replace(training.budget, **{number: 2 * getattr(training.budget, number)})
        assert ours.stages(ours.variant(), more)[1].reads != invert.reads, number


WRONG: Mapping[str, dict[str, list[Any]]] = {
    "gs-ir": {"lr_scale": [-1.0], "tau": [0.0], "nearest": [-0.1], "view_share": [0.0, 1.5]},
    "gi-gs": {
        "lr_scale": [-1.0], "start": [-1], "radius": [0.0], "far": [0.0], "bias": [-0.1], "thick": [-1.0],
        "view_share": [0.0, 1.5],
    },
    "irgs": {"lr_scale": [-1.0], "ray_start": [-0.1], "view_share": [0.0, 1.5]},
    "r3dg": {"hidden_below": [-0.1, 1.1], "ray_start": [-0.1], "view_share": [0.0, 1.5]},
    "svg-ir": {
        "hop": [0.0], "gap": [-1.0], "ray_start": [-0.1], "view_share": [0.0, 1.5], "opaque": [1.0],
        "relight_rows": [0],
    },
    "tensoir": {
        "view_share": [0.0, 1.5],
        "learning": [Learning(schedule=Schedule(finer_at=(1.0,))), Learning(schedule=Schedule(emptied_at=(-0.1,)))],
    },
    "radiogs": {"view_share": [0.0, 1.5], "radiometric_weight": [-1.0]},
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "field", "value"),
    [(name, field, value) for name, fields in WRONG.items() for field, values in fields.items() for value in values],
)
def test_an_invalid_variant_is_refused(name: str, field: str, value: Any) -> None:
    with pytest.raises(UsageError, match=field):
        method(name).variant(**{field: value})


def test_every_surfel_method_is_in_the_table() -> None:
    assert set(ADAPTERS) == set(MODELS) - {"tensoir"}
    assert set(WRONG) == {*MODELS, "radiogs"}
