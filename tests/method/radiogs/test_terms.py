"""Every term of both stages' losses: the errors that raise it, its weight, and its beginning."""

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import Any

import pytest
import torch

from known_ball import BALL, BUDGET, COLOUR, SCENE, WHITE, changed, initialisation, inverse_rendering, noise, tilted
from radiogs.invert import InverseRendering
from radiogs.learning import IncidentDirections, MaterialLearning, MaterialRates, MaterialWeights, SplitSumLearning
from radiogs.settings import Variant
from radiogs.showing import Renderer
from radiogs_core.learning.geometry import GeometryLearning, GeometrySchedule, GeometryWeights
from radiogs_core.plain_values import with_values
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.surfels.harmonics import COEFFICIENTS
from radiogs_core.surfels.surfels import Surfels, radiance_to_sh
from radiogs_core.transport.incident import Incident

EARLY, LATE = 0.2, 0.9
"""Shares of a stage at which all terms count, before and after all changes of the schedule."""

IMAGES = {"radiance", "shaded"}
OF_GEOMETRY: Mapping[str, set[str]] = {
    "absolute": IMAGES,
    "similarity": IMAGES,
    "radiance": {"radiance"},
    "normal": {"normal"},
    "normal_late": {"normal"},
    "distortion": {"distortion"},
    "mask": {"mask"},
    "normal_smoothness": {"normal smoothness"},
}
OF_MATERIALS: Mapping[str, set[str]] = {
    "absolute": IMAGES,
    "similarity": IMAGES,
    "squared": {"shaded"},
    "normal": {"normal"},
    "distortion": {"distortion"},
    "mask": {"mask"},
    "normal_smoothness": {"normal smoothness"},
    "albedo_smoothness": {"albedo smoothness"},
    "roughness_smoothness": {"roughness smoothness"},
    "light_prior": {"light prior"},
    "light_smoothness": {"light smoothness"},
}
"""The terms that each field of ``GeometryWeights`` and of ``MaterialWeights`` weighs."""

GEOMETRY = ("centre", "rotation", "log_scale", "opacity_logit")
MATERIALS = ("albedo_logit", "roughness_logit", "log_environment", "sh", "sh_rest")

TINTED = WHITE + torch.tensor([0.5, 0.0, -0.5])
SPECKLED = WHITE + noise(WHITE, 0.5)


def learning(**materials: object) -> Variant:
    return Variant(materials=replace(MaterialLearning(), **materials))  # type: ignore[arg-type]


def weighing(**weights: float) -> Variant:
    """Stage 1 with these weights of geometry."""
    return Variant(geometry=GeometryLearning(weights=replace(GeometryWeights(), **weights)))


def weighing_materials(**weights: float) -> Variant:
    return learning(weights=replace(MaterialWeights(), **weights))


def speckled_albedo() -> torch.Tensor:
    return BALL.albedo_logit + noise(BALL.albedo_logit, 1.0)


def speckled_roughness() -> torch.Tensor:
    return BALL.roughness_logit + noise(BALL.roughness_logit, 2.0)


def half_there() -> torch.Tensor:
    return torch.zeros_like(BALL.opacity_logit)


def worn() -> Surfels:
    """The ball with errors in all parameters, so that no term of stage 1 is zero."""
    return changed(
        rotation=tilted(20.0).rotation, centre=BALL.centre * (1 + noise(BALL.opacity_logit, 0.05))[:, None],
        opacity_logit=half_there(), albedo_logit=speckled_albedo(),
    )  # fmt: skip


def worn_in_place() -> Surfels:
    """The same without errors of position, and speckled: no term of stage 2 is zero under a wrong light."""
    return changed(
        rotation=tilted(20.0).rotation, opacity_logit=half_there(), albedo_logit=speckled_albedo(),
        roughness_logit=speckled_roughness(),
    )  # fmt: skip


def glowing(factor: float) -> Surfels:
    sh = BALL.sh.clone()
    sh[:, 0] = radiance_to_sh(factor * torch.tensor([COLOUR]))
    return changed(sh=sh)


def painted(shift: float) -> Surfels:
    return changed(albedo_logit=BALL.albedo_logit + shift)


def test_every_term_has_a_positive_value_and_a_weight() -> None:
    assert OF_GEOMETRY.keys() == {each.name for each in fields(GeometryWeights)}
    assert OF_MATERIALS.keys() == {each.name for each in fields(MaterialWeights)}
    second = inverse_rendering(worn_in_place(), LATE, weighing_materials(distortion=1.0), TINTED + SPECKLED)
    for stage, terms in ((initialisation(worn(), LATE), OF_GEOMETRY), (second, OF_MATERIALS)):
        losses = stage.step()
        assert set(losses) == {"consistency"}.union(*terms.values())
        assert all(value > 0 for value in losses.values()), losses


def scaled_by(losses_of: Callable[[float], Mapping[str, float]]) -> set[str]:
    """The terms that a weight scales, by the losses without it, with it, and with twice as much; no other changes."""
    none, once, twice = (losses_of(factor) for factor in (0.0, 1.0, 2.0))
    assert once.keys() == twice.keys()
    scaled = {name for name, value in once.items() if twice[name] != value}
    for name in scaled:
        assert twice[name] == pytest.approx(2 * once[name], rel=1e-5)
        assert none.get(name, 0.0) == 0.0 < once[name]
    return scaled


@pytest.mark.parametrize("field", OF_GEOMETRY)
def test_each_weight_of_stage_1_scales_its_own_term_alone(field: str) -> None:
    surfels, weight = worn(), getattr(GeometryWeights(), field)
    other = "similarity" if field == "absolute" else "absolute"
    alone = {other: 0.0} if OF_GEOMETRY[field] == IMAGES else {}

    def scaled(share: float) -> set[str]:
        return scaled_by(lambda by: initialisation(surfels, share, weighing(**alone, **{field: by * weight})).step())

    early, late = scaled(EARLY), scaled(LATE)
    assert early | late == OF_GEOMETRY[field]


@pytest.mark.parametrize("field", OF_MATERIALS)
def test_each_weight_of_stage_2_scales_its_own_term_alone(field: str) -> None:
    """A term that is off by default has the weight 1."""
    surfels, light, weight = worn_in_place(), TINTED + SPECKLED, getattr(MaterialWeights(), field) or 1.0
    of_images = [name for name, terms in OF_MATERIALS.items() if terms <= IMAGES]
    alone = {name: 0.0 for name in of_images if name != field} if field in of_images else {}

    def scaled(share: float) -> set[str]:
        return scaled_by(
            lambda by: inverse_rendering(
                surfels, share, weighing_materials(**alone, **{field: by * weight}), light
            ).step()
        )

    early, late = scaled(EARLY), scaled(LATE)
    assert early | late == OF_MATERIALS[field]


@pytest.mark.parametrize(("field", "term"), [("consistency", "consistency"), ("image", "shaded")])
def test_each_weight_of_the_split_sum_scales_its_own_term_alone(field: str, term: str) -> None:
    surfels, weight = worn(), getattr(SplitSumLearning(), field)

    def losses_of(by: float) -> Mapping[str, float]:
        return initialisation(surfels, LATE, Variant(split_sum=SplitSumLearning(**{field: by * weight}))).step()

    assert scaled_by(losses_of) == {term}


@pytest.mark.parametrize("shading", ["monte-carlo", "split-sum"])
def test_the_weight_of_the_consistency_scales_it_alone(shading: str) -> None:
    def losses_of(by: float) -> Mapping[str, float]:
        variant = Variant(radiometric_weight=by * Variant().radiometric_weight, shading=shading)
        return inverse_rendering(worn_in_place(), LATE, variant).step()

    assert scaled_by(losses_of) == {"consistency"}


@pytest.mark.parametrize("begun", [initialisation, inverse_rendering])
def test_images_are_compared_in_display_colour_with_linear_radiance(begun: Any) -> None:
    """A surfel with the display values as its linear radiance and albedo is too bright."""
    display = srgb_encode(torch.tensor(COLOUR))
    bright = glowing(1.0)
    bright.sh[:, 0] = radiance_to_sh(display[None])
    bright.albedo_logit = torch.logit(display).expand(len(BALL), 3).contiguous()
    right, wrong = (begun(surfels, LATE).step() for surfels in (BALL, bright))
    for term in IMAGES:
        assert right[term] < 0.5 * wrong[term]


# Stage 1


@pytest.mark.parametrize("weight", ["image", "consistency"])
def test_the_split_sum_has_gradient_to_geometry_only_with_geometry_gradient(weight: str) -> None:
    def after_a_step(factor: float, shapes: bool) -> dict[str, torch.Tensor]:
        split_sum = SplitSumLearning(**{"image": 0.0, "consistency": 0.0, weight: factor}, geometry_gradient=shapes)
        stage = initialisation(worn(), LATE, Variant(split_sum=split_sum))
        stage.step()
        return {name: stage.optimiser.tensors[name].detach().clone() for name in (*GEOMETRY, "albedo_logit")}

    none, much, shaping = after_a_step(0.0, False), after_a_step(100.0, False), after_a_step(100.0, True)
    assert all(torch.equal(none[name], much[name]) for name in GEOMETRY)
    assert not torch.equal(none["albedo_logit"], much["albedo_logit"])
    reached = {name for name in GEOMETRY if not torch.equal(none[name], shaping[name])}
    assert reached == ({"rotation"} if weight == "consistency" else set(GEOMETRY))


def spread() -> Surfels:
    generator = torch.Generator().manual_seed(0)
    return changed(centre=BALL.centre * (1 - 0.3 * torch.rand(len(BALL), 1, generator=generator)),
                   opacity_logit=half_there())  # fmt: skip


@pytest.mark.parametrize(
    ("term", "before", "after"),
    [
        ("normal", BALL, tilted(35.0)),
        ("normal smoothness", BALL, tilted(35.0)),
        ("mask", BALL, changed(opacity_logit=half_there() - 2)),
        ("mask", BALL, changed(centre=1.3 * BALL.centre)),
        ("mask", BALL, changed(centre=0.8 * BALL.centre)),
        ("distortion", changed(opacity_logit=half_there()), spread()),
        ("radiance", BALL, glowing(2.0)),
        ("radiance", BALL, glowing(0.5)),
        ("shaded", BALL, painted(1.0)),
        ("shaded", BALL, painted(-1.0)),
        ("consistency", BALL, glowing(2.0)),
        ("consistency", BALL, glowing(0.5)),
        ("consistency", BALL, painted(1.0)),
    ],
)
def test_a_wrong_model_raises_the_term_of_stage_1(term: str, before: Surfels, after: Surfels) -> None:
    right, wrong = (initialisation(surfels, LATE).step()[term] for surfels in (before, after))
    assert wrong > 1.2 * right


def test_a_wrong_light_raises_the_terms_of_the_split_sum() -> None:
    for term in ("shaded", "consistency"):
        right, *wrong = (initialisation(BALL, LATE, light=WHITE + shift).step()[term] for shift in (0.0, 0.7, -0.7))
        assert min(wrong) > 1.2 * right


def test_an_invisible_model_costs_the_contrast_to_white_and_black_in_turn() -> None:
    """With L1 alone, one view and no visible surfel, the loss is the mean of |image - background|."""
    nothing = changed(opacity_logit=torch.full_like(BALL.opacity_logit, -20.0))
    variant = replace(weighing(absolute=1.0, similarity=0.0), view_share=0.01, initialise="nvs")
    stage = initialisation(nothing, EARLY, variant)
    assert len(stage.views) == 1
    covered, display = stage.views[0].mask.mean(), srgb_encode(torch.tensor(COLOUR))
    found = [initialisation(nothing, EARLY + step / 1000, variant).step()["radiance"] for step in range(4)]
    on_white, on_black = (float(covered * (display - background).abs().mean()) for background in (1.0, 0.0))
    assert found == pytest.approx([on_white, on_black] * 2, rel=1e-4)


def test_the_similarity_term_compares_structure() -> None:
    """A slightly darker ball has the structure of the images; a speckled one has not."""
    variant = replace(weighing(absolute=0.0, similarity=1.0), initialise="nvs")
    speckled = BALL.sh.clone()
    speckled[:, 0] += noise(speckled[:, 0], 0.7)
    right, darker, rough = (
        initialisation(each, LATE, variant).step()["radiance"] for each in (BALL, glowing(0.8), changed(sh=speckled))
    )
    assert right > 0
    assert darker < 1.2 * right
    assert 2 * right < rough <= 1
    absolute = replace(weighing(absolute=1.0, similarity=0.0), initialise="nvs")
    right, darker = (initialisation(each, LATE, absolute).step()["radiance"] for each in (BALL, glowing(0.8)))
    assert darker > 1.1 * right


@pytest.mark.parametrize(
    ("term", "variant"),
    [
        ("distortion", Variant(geometry=GeometryLearning(schedule=GeometrySchedule(distortion_from=0.4)))),
        ("consistency", Variant(split_sum=SplitSumLearning(consistency_from=0.4))),
    ],
)
def test_terms_begin_at_their_share_of_the_stage(term: str, variant: Variant) -> None:
    before, after = (initialisation(worn(), share, variant).step() for share in (0.39, 0.4))
    assert term not in before
    assert after[term] > 0
    assert set(after) - set(before) == {term}


def test_the_late_weight_of_normals_begins_at_its_share_of_the_stage() -> None:
    schedule, factor = GeometrySchedule(normal_late_from=0.4), 3.0
    for share, counts in ((0.0, False), (0.39, False), (0.4, True), (LATE, True)):
        same, other = (
            initialisation(
                worn(),
                share,
                Variant(geometry=GeometryLearning(schedule=schedule, weights=GeometryWeights(normal_late=late))),
            ).step()["normal"]
            for late in (GeometryWeights().normal, factor * GeometryWeights().normal)
        )
        assert other == pytest.approx((factor if counts else 1.0) * same, rel=1e-5)


def test_distortion_and_consistency_do_not_count_at_the_start() -> None:
    """Both would fix geometry that is not learnt yet."""
    assert not {"distortion", "consistency"} & set(initialisation(worn(), 0.0).step())


def test_degrees_of_harmonics_begin_at_their_shares_of_the_stage() -> None:
    """Before its share of the stage, a degree is not rendered and not learnt."""
    schedule = GeometrySchedule(degrees_from=(0.2, 0.4, 0.6))
    variant = Variant(geometry=GeometryLearning(schedule=schedule))
    sh = BALL.sh.clone()
    sh[:, 1:] = noise(sh[:, 1:], 0.2)
    for degree, share in enumerate((0.1, 0.3, 0.5, 0.7)):
        known = (degree + 1) ** 2
        stage = initialisation(changed(sh=sh), share, variant)
        found = stage.step()
        still = (stage.optimiser.tensors["sh_rest"] == sh[:, 1:]).all(-1).all(0)
        assert still.tolist() == [index >= known for index in range(1, COEFFICIENTS)]
        for kept in {known, degree**2}:
            cut = sh.clone()
            cut[:, kept:] = 0
            same = initialisation(changed(sh=cut), share, variant).step()["radiance"] == found["radiance"]
            assert same == (kept == known)


def test_by_default_radiance_begins_with_degree_0_and_ends_with_all_degrees() -> None:
    sh = BALL.sh.clone()
    sh[:, 1:] = noise(sh[:, 1:], 0.2)
    for share, shows in ((0.0, False), (LATE, True)):
        found, flat = (initialisation(changed(sh=each), share).step()["radiance"] for each in (sh, BALL.sh))
        assert (found != flat) == shows


def test_the_budgets_rate_scales_positions_and_its_root_scales_rotations() -> None:
    """The length of Adam's first step equals the rate."""
    rates = Variant().geometry.rates
    for factor in (1.0, 9.0):
        stage = initialisation(worn(), 0.0, budget=with_values(BUDGET, {"geometry.rate": factor}))
        before = {name: stage.optimiser.tensors[name].detach().clone() for name in ("centre", "rotation", "log_scale")}
        stage.step()
        moved = {
            name: float((stage.optimiser.tensors[name].detach() - value).abs().max()) for name, value in before.items()
        }
        assert moved["centre"] == pytest.approx(factor * rates.position * SCENE.extent, rel=1e-3)
        assert moved["rotation"] == pytest.approx(factor**0.5 * rates.rotation, rel=1e-3)
        assert moved["log_scale"] == pytest.approx(rates.scale, rel=1e-3)


def test_the_known_ball_reproduces_the_images_of_the_scene() -> None:
    """The known surfels are close to the truth: their images differ at the soft silhouette alone."""
    stage = initialisation(BALL, LATE)
    losses = stage.step()
    assert losses["radiance"] < 0.05
    assert losses["shaded"] < 0.05
    assert len(stage.views) == len(SCENE.train)


# Stage 2


@pytest.fixture(scope="module")
def of_the_ball() -> Mapping[str, float]:
    """Losses of the right model."""
    return inverse_rendering(BALL, LATE).step()


@pytest.mark.parametrize(
    ("term", "wrong"),
    [
        ("normal", tilted(35.0)),
        ("normal smoothness", tilted(35.0)),
        ("mask", changed(opacity_logit=torch.full_like(BALL.opacity_logit, -2.0))),
        ("mask", changed(centre=1.3 * BALL.centre)),
        ("mask", changed(centre=0.8 * BALL.centre)),
        ("albedo smoothness", changed(albedo_logit=speckled_albedo())),
        ("roughness smoothness", changed(roughness_logit=speckled_roughness())),
        ("radiance", glowing(2.0)),
        ("radiance", glowing(0.5)),
        ("shaded", painted(1.5)),
        ("shaded", painted(-1.5)),
        ("consistency", glowing(2.0)),
        ("consistency", glowing(0.5)),
        ("consistency", painted(1.5)),
    ],
)
def test_a_wrong_model_raises_the_term_of_stage_2(term: str, wrong: Surfels, of_the_ball: Mapping[str, float]) -> None:
    assert inverse_rendering(wrong, LATE).step()[term] > 1.05 * of_the_ball[term]


LEARNT = with_values(Variant(), {"materials.rates.light": 5e-4})
"""With a light that is learnt; losses of a light that is held are left out."""


def test_a_light_that_is_held_has_no_losses() -> None:
    held, learnt = (set(inverse_rendering(BALL, LATE, variant).step()) for variant in (Variant(), LEARNT))
    assert learnt - held == {"light prior", "light smoothness"}
    assert held < learnt


@pytest.mark.parametrize(
    ("term", "light"),
    [
        ("light prior", TINTED),
        ("light smoothness", SPECKLED),
        ("shaded", WHITE + 1.0),
        ("shaded", WHITE - 1.0),
        ("consistency", WHITE + 1.0),
        ("consistency", WHITE - 1.0),
    ],
)
def test_a_wrong_light_raises_the_term(term: str, light: torch.Tensor) -> None:
    right, wrong = (inverse_rendering(BALL, LATE, LEARNT, light=each).step()[term] for each in (WHITE, light))
    assert wrong > 1.2 * right


def test_the_two_light_priors_respond_to_tint_and_to_noise() -> None:
    """A tint raises the light prior alone; noise raises the light smoothness."""
    tint, speckle = (inverse_rendering(BALL, LATE, LEARNT, light=each).step() for each in (TINTED, SPECKLED))
    assert tint["light smoothness"] < 1e-9 < speckle["light smoothness"]
    assert tint["light prior"] > 3 * speckle["light prior"]


@pytest.mark.parametrize("shading", ["monte-carlo", "split-sum"])
@pytest.mark.parametrize("weight", [0.0, 0.2])
def test_the_images_alone_move_light_and_materials_with_and_without_l_rad(shading: str, weight: float) -> None:
    """The light has no other loss here; L_rad traces its rays, and reads the light, at any weight."""
    without_priors = {"materials.weights.light_prior": 0.0, "materials.weights.light_smoothness": 0.0}
    variant = with_values(LEARNT, {"radiometric_weight": weight, "shading": shading, **without_priors})
    stage = inverse_rendering(worn_in_place(), LATE, variant, TINTED + SPECKLED)
    before = {name: value.detach().clone() for name, value in stage.optimiser.tensors.items()}
    stage.step()
    for name in ("log_environment", "albedo_logit", "roughness_logit", "sh"):
        assert not torch.equal(stage.optimiser.tensors[name], before[name]), name


def test_materials_change_the_shaded_image_alone_and_radiance_its_own_image() -> None:
    right, bright, pale = (inverse_rendering(each, LATE).step() for each in (BALL, glowing(2.0), painted(1.5)))
    assert bright["shaded"] == right["shaded"]
    assert pale["radiance"] == right["radiance"]


def test_the_normal_term_begins_at_its_share_of_the_stage() -> None:
    variant = learning(normal_from=0.4)
    before, after = (inverse_rendering(worn_in_place(), share, variant).step() for share in (0.39, 0.4))
    assert set(after) - set(before) == {"normal"}
    assert after["normal"] > 0
    assert "normal" not in inverse_rendering(worn_in_place(), 0.0).step()


def test_the_image_weight_of_the_released_code_scales_the_shaded_image_alone() -> None:
    ours, theirs = (
        inverse_rendering(BALL, LATE, replace(weighing_materials(similarity=0.0, squared=0.0), deviations=names)).step()
        for names in ((), ("image-weight",))
    )
    assert theirs["shaded"] == pytest.approx(ours["shaded"] / MaterialWeights().absolute, rel=1e-5)
    assert theirs["radiance"] == ours["radiance"]


def steps_of(variant: Variant) -> dict[str, float]:
    """The largest change of each raw parameter in a first step; positions in scene extents."""
    stage = inverse_rendering(worn_in_place(), LATE, variant, TINTED + SPECKLED)
    before = {name: value.detach().clone() for name, value in stage.optimiser.tensors.items()}
    stage.step()
    found = {
        name: float((value.detach() - before[name]).abs().max()) for name, value in stage.optimiser.tensors.items()
    }
    return found | {"centre": found["centre"] / SCENE.extent}


def test_geometry_is_refined_and_not_learnt_again() -> None:
    """The length of Adam's first step equals the rate, which is far lower than in stage 1."""
    found, first = steps_of(Variant()), Variant().geometry.rates
    for name, rate in zip(GEOMETRY, (first.position, first.rotation, first.scale, first.opacity), strict=True):
        assert 0 < found[name] < 0.1 * rate, name


def test_the_factor_of_geometry_rates_scales_geometry_alone() -> None:
    share = MaterialRates().geometry
    once, twice = (steps_of(learning(rates=replace(MaterialRates(), geometry=each))) for each in (share, 2 * share))
    for name in GEOMETRY:
        assert twice[name] == pytest.approx(2 * once[name], rel=0.05), name
    for name in MATERIALS:
        assert twice[name] == once[name] > 0, name


@pytest.mark.parametrize(
    ("rate", "moves"),
    [
        ("albedo", "albedo_logit"),
        ("roughness", "roughness_logit"),
        ("constant_light", "log_environment"),  # too little is seen of the worn ball to search for a light
        ("radiance", "sh"),
        ("radiance_rest", "sh_rest"),
    ],
)
def test_each_rate_moves_its_own_parameter_alone(rate: str, moves: str) -> None:
    once = steps_of(Variant())
    twice = steps_of(learning(rates=replace(MaterialRates(), **{rate: 2 * getattr(MaterialRates(), rate)})))
    assert {name for name in once if twice[name] > 1.5 * once[name]} == {moves}


LOWEST = 0.17364818
"""Sine of 10 degrees, the lowest height of the released code's directions."""


def sight_and_height(surfels: Surfels, incident: Incident) -> tuple[float, float]:
    """Mean visibility, and the least cosine of a direction with its surfel's normal."""
    height = (incident.direction * surfels.frame[:, None, :, 2]).sum(-1)
    return float(incident.visibility.mean()), float(height.min())


def assert_rays_follow_their_deviations(
    light_on: Callable[[InverseRendering], Incident], steps: int, always: tuple[str, ...] = ()
) -> None:
    """The deviations change visibility and directions, for tilted surfels that occlude each other.

    An offset of 0.05 is smaller than their standard deviation. All directions are spread over the hemisphere, because
    directions drawn from the light have no floor.
    """
    surfels, found = tilted(35.0), {}
    materials = replace(MaterialLearning(), directions=IncidentDirections(from_light=0.0, sets=1))
    for deviations in ((), ("fixed-offset",), ("hemisphere-floor",)):
        stage = inverse_rendering(surfels, LATE, Variant(deviations=always + deviations, materials=materials))
        for _ in range(steps):
            stage.step()
        found[deviations] = sight_and_height(surfels, light_on(stage))
    sight, lowest = found[()]
    assert found["fixed-offset",][0] < sight - 0.005
    assert lowest < LOWEST - 0.01
    assert found["hemisphere-floor",][1] == pytest.approx(LOWEST, abs=1e-4)


@pytest.mark.parametrize("steps", [0, 1])
def test_the_deviations_of_rays_reach_stage_two(steps: int) -> None:
    """At the trace of all surfels, and at the trace for L_rad, which here draws all surfels."""
    assert_rays_follow_their_deviations(lambda stage: stage.shader.cache.incident, steps)


def test_the_deviations_of_rays_reach_rendering() -> None:
    """With spread directions alone, because directions drawn from the light have no floor."""
    spread = ("spread-views",)
    assert_rays_follow_their_deviations(lambda stage: Renderer(stage.model, 16, stage.variant).incident, 0, spread)
