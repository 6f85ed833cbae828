"""Every term of stage 1's losses: the errors that raise it, its weight, and its beginning."""

from collections.abc import Mapping
from dataclasses import fields, replace

import pytest
import torch

from known_ball import BALL, BUDGET, COLOUR, SCENE, WHITE, changed, initialisation, noise, tilted
from radiogs.learning import SplitSumLearning
from radiogs.settings import Variant
from radiogs_core.learning.geometry import GeometryLearning, GeometrySchedule, GeometryWeights
from radiogs_core.plain_values import with_values
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.surfels.harmonics import COEFFICIENTS
from radiogs_core.surfels.surfels import Surfels, radiance_to_sh

EARLY, LATE = 0.2, 0.9
"""Shares of the stage at which all terms count, before and after all changes of the schedule."""

IMAGES = {"radiance", "shaded"}
TERMS: Mapping[str, set[str]] = {
    "absolute": IMAGES,
    "similarity": IMAGES,
    "radiance": {"radiance"},
    "normal": {"normal"},
    "distortion": {"distortion"},
    "mask": {"mask"},
    "normal_smoothness": {"normal smoothness"},
}
"""The terms that each field of ``GeometryWeights`` weighs; any other field weighs the term that begins its name."""


def weighing(**weights: float) -> Variant:
    return Variant(geometry=GeometryLearning(weights=replace(GeometryWeights(), **weights)))


def worn() -> Surfels:
    """The ball with errors in all parameters, so that no term is zero."""
    surfels = tilted(20.0)
    return changed(
        rotation=surfels.rotation,
        centre=BALL.centre * (1 + noise(BALL.opacity_logit, 0.05))[:, None],
        opacity_logit=torch.zeros_like(BALL.opacity_logit),
        albedo_logit=BALL.albedo_logit + noise(BALL.albedo_logit, 1.0),
    )


def terms_of(field: str) -> set[str]:
    return TERMS[field] if field in TERMS else TERMS[field.split("_")[0]]


def test_every_term_has_a_positive_value_and_a_weight() -> None:
    losses = initialisation(worn(), LATE).step()
    assert set(losses) == {"consistency"}.union(*TERMS.values())
    assert all(value > 0 for value in losses.values()), losses


@pytest.mark.parametrize("field", [each.name for each in fields(GeometryWeights)])
def test_each_weight_scales_its_own_term_alone(field: str) -> None:
    surfels, own, ever = worn(), terms_of(field), set[str]()
    other = "similarity" if field == "absolute" else "absolute"
    alone = {other: 0.0} if own == IMAGES else {}
    weight = getattr(GeometryWeights(), field)
    for share in (EARLY, LATE):
        none, once, twice = (
            initialisation(surfels, share, weighing(**alone, **{field: factor * weight})).step()
            for factor in (0.0, 1.0, 2.0)
        )
        assert once.keys() == twice.keys()
        moved = {name for name, value in once.items() if twice[name] != value}
        assert moved <= own
        for name in moved:
            assert twice[name] == pytest.approx(2 * once[name], rel=1e-5)
            assert none.get(name, 0.0) == 0.0
        ever |= moved
    assert ever == own


@pytest.mark.parametrize(("field", "term"), [("consistency", "consistency"), ("image", "shaded")])
def test_each_weight_of_the_split_sum_scales_its_own_term_alone(field: str, term: str) -> None:
    surfels = worn()
    weight = getattr(SplitSumLearning(), field)
    none, once, twice = (
        initialisation(surfels, LATE, Variant(split_sum=SplitSumLearning(**{field: factor * weight}))).step()
        for factor in (0.0, 1.0, 2.0)
    )
    assert {name for name in once if twice[name] != once[name]} == {term}
    assert twice[term] == pytest.approx(2 * once[term], rel=1e-5)
    assert none.get(term, 0.0) == 0.0 < once[term]


SHAPE = ("centre", "rotation", "log_scale", "opacity_logit")


@pytest.mark.parametrize("weight", ["image", "consistency"])
def test_the_split_sum_has_gradient_to_geometry_only_with_geometry_gradient(weight: str) -> None:
    def after_a_step(factor: float, shapes: bool) -> dict[str, torch.Tensor]:
        split_sum = SplitSumLearning(**{"image": 0.0, "consistency": 0.0, weight: factor}, geometry_gradient=shapes)
        stage = initialisation(worn(), LATE, Variant(split_sum=split_sum))
        stage.step()
        return {name: stage.optimiser.tensors[name].detach().clone() for name in (*SHAPE, "albedo_logit")}

    none, much, shaping = after_a_step(0.0, False), after_a_step(100.0, False), after_a_step(100.0, True)
    assert all(torch.equal(none[name], much[name]) for name in SHAPE)
    assert not torch.equal(none["albedo_logit"], much["albedo_logit"])
    reached = {name for name in SHAPE if not torch.equal(none[name], shaping[name])}
    assert reached == ({"rotation"} if weight == "consistency" else set(SHAPE))


def half_there() -> torch.Tensor:
    return torch.zeros_like(BALL.opacity_logit)


def spread() -> Surfels:
    generator = torch.Generator().manual_seed(0)
    return changed(centre=BALL.centre * (1 - 0.3 * torch.rand(len(BALL), 1, generator=generator)),
                   opacity_logit=half_there())  # fmt: skip


def glowing(factor: float) -> Surfels:
    sh = BALL.sh.clone()
    sh[:, 0] = radiance_to_sh(factor * torch.tensor([COLOUR]))
    return changed(sh=sh)


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
        ("shaded", BALL, changed(albedo_logit=BALL.albedo_logit + 1)),
        ("shaded", BALL, changed(albedo_logit=BALL.albedo_logit - 1)),
        ("consistency", BALL, glowing(2.0)),
        ("consistency", BALL, glowing(0.5)),
        ("consistency", BALL, changed(albedo_logit=BALL.albedo_logit + 1)),
    ],
)
def test_a_wrong_model_raises_the_term(term: str, before: Surfels, after: Surfels) -> None:
    right, wrong = (initialisation(surfels, LATE).step()[term] for surfels in (before, after))
    assert wrong > 1.2 * right


def test_a_wrong_light_raises_the_terms_of_the_split_sum() -> None:
    for term in ("shaded", "consistency"):
        right, *wrong = (initialisation(BALL, LATE, light=WHITE + shift).step()[term] for shift in (0.0, 0.7, -0.7))
        assert min(wrong) > 1.2 * right


def test_images_are_compared_in_display_colour_with_linear_radiance() -> None:
    """A surfel with the display values as its linear radiance and albedo is too bright."""
    display = srgb_encode(torch.tensor(COLOUR))
    bright = glowing(1.0)
    bright.sh[:, 0] = radiance_to_sh(display[None])
    bright.albedo_logit = torch.logit(display).expand(len(BALL), 3).contiguous()
    right, wrong = (initialisation(surfels, LATE).step() for surfels in (BALL, bright))
    for term in IMAGES:
        assert right[term] < 0.5 * wrong[term]


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
    """Before its share of the stage, a degree is neither rendered nor learnt."""
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
