"""Every term of stage 2's losses: the errors that raise it, its weight, and its beginning."""

from collections.abc import Callable, Mapping
from dataclasses import fields, replace

import pytest
import torch

from known_ball import BALL, COLOUR, SCENE, WHITE, changed, inverse_rendering, noise, tilted
from radiogs.invert import InverseRendering
from radiogs.learning import IncidentDirections, MaterialLearning, MaterialRates, MaterialWeights
from radiogs.settings import Variant
from radiogs.showing import Renderer
from radiogs_core.plain_values import with_values
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.surfels.surfels import Surfels, radiance_to_sh
from radiogs_core.transport.incident import Incident

EARLY, LATE = 0.2, 0.9
"""Shares of the stage at which all terms count, before and after all changes of the schedule."""

IMAGES = {"radiance", "shaded"}
TERMS: Mapping[str, set[str]] = {
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
"""The terms that each field of ``MaterialWeights`` weighs; any other field weighs the term that begins its name."""

GEOMETRY = ("centre", "rotation", "log_scale", "opacity_logit")
MATERIALS = ("albedo_logit", "roughness_logit", "log_environment", "sh", "sh_rest")

TINTED = WHITE + torch.tensor([0.5, 0.0, -0.5])
SPECKLED = WHITE + noise(WHITE, 0.5)


def learning(**materials: object) -> Variant:
    return Variant(materials=replace(MaterialLearning(), **materials))  # type: ignore[arg-type]


def weighing(**weights: float) -> Variant:
    return learning(weights=replace(MaterialWeights(), **weights))


def speckled_albedo() -> torch.Tensor:
    return BALL.albedo_logit + noise(BALL.albedo_logit, 1.0)


def speckled_roughness() -> torch.Tensor:
    return BALL.roughness_logit + noise(BALL.roughness_logit, 2.0)


def worn() -> Surfels:
    """The ball with errors in all parameters, so that no term is zero under a wrong light."""
    return changed(
        rotation=tilted(20.0).rotation, opacity_logit=torch.zeros_like(BALL.opacity_logit),
        albedo_logit=speckled_albedo(), roughness_logit=speckled_roughness(),
    )  # fmt: skip


def terms_of(field: str) -> set[str]:
    return TERMS[field] if field in TERMS else TERMS[field.split("_")[0]]


def weight_of(field: str) -> float:
    """The default, or 1 for a term that is off by default."""
    return getattr(MaterialWeights(), field) or 1.0


def test_every_term_has_a_positive_value_and_a_weight() -> None:
    losses = inverse_rendering(worn(), LATE, weighing(distortion=1.0), TINTED + SPECKLED).step()
    assert set(losses) == {"consistency"}.union(*TERMS.values())
    assert all(value > 0 for value in losses.values()), losses


@pytest.mark.parametrize("field", [each.name for each in fields(MaterialWeights)])
def test_each_weight_scales_its_own_term_alone(field: str) -> None:
    surfels, light, own, ever = worn(), TINTED + SPECKLED, terms_of(field), set[str]()
    of_images = [name for name, terms in TERMS.items() if terms <= IMAGES]
    alone = {name: 0.0 for name in of_images if name != field} if field in of_images else {}
    weight = weight_of(field)
    for share in (EARLY, LATE):
        none, once, twice = (
            inverse_rendering(surfels, share, weighing(**alone, **{field: factor * weight}), light).step()
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


@pytest.mark.parametrize("shading", ["monte-carlo", "split-sum"])
def test_the_weight_of_the_consistency_scales_it_alone(shading: str) -> None:
    weight = Variant().radiometric_weight
    none, once, twice = (
        inverse_rendering(worn(), LATE, Variant(radiometric_weight=factor * weight, shading=shading)).step()
        for factor in (0.0, 1.0, 2.0)
    )
    assert {name for name in once if twice[name] != once[name]} == {"consistency"}
    assert twice["consistency"] == pytest.approx(2 * once["consistency"], rel=1e-5)
    assert none["consistency"] == 0.0 < once["consistency"]


def glowing(factor: float) -> Surfels:
    sh = BALL.sh.clone()
    sh[:, 0] = radiance_to_sh(factor * torch.tensor([COLOUR]))
    return changed(sh=sh)


def painted(shift: float) -> Surfels:
    return changed(albedo_logit=BALL.albedo_logit + shift)


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
def test_a_wrong_model_raises_the_term(term: str, wrong: Surfels, of_the_ball: Mapping[str, float]) -> None:
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
    stage = inverse_rendering(worn(), LATE, variant, TINTED + SPECKLED)
    before = {name: value.detach().clone() for name, value in stage.optimiser.tensors.items()}
    stage.step()
    for name in ("log_environment", "albedo_logit", "roughness_logit", "sh"):
        assert not torch.equal(stage.optimiser.tensors[name], before[name]), name


def test_images_are_compared_in_display_colour_with_linear_radiance() -> None:
    """A surfel with the display values as its linear radiance and albedo is too bright."""
    display = srgb_encode(torch.tensor(COLOUR))
    bright = glowing(1.0)
    bright.sh[:, 0] = radiance_to_sh(display[None])
    bright.albedo_logit = torch.logit(display).expand(len(BALL), 3).contiguous()
    right, wrong = (inverse_rendering(surfels, LATE).step() for surfels in (BALL, bright))
    for term in IMAGES:
        assert right[term] < 0.5 * wrong[term]


def test_materials_change_the_shaded_image_alone_and_radiance_its_own_image() -> None:
    right, bright, pale = (inverse_rendering(each, LATE).step() for each in (BALL, glowing(2.0), painted(1.5)))
    assert bright["shaded"] == right["shaded"]
    assert pale["radiance"] == right["radiance"]


def test_the_normal_term_begins_at_its_share_of_the_stage() -> None:
    variant = learning(normal_from=0.4)
    before, after = (inverse_rendering(worn(), share, variant).step() for share in (0.39, 0.4))
    assert set(after) - set(before) == {"normal"}
    assert after["normal"] > 0
    assert "normal" not in inverse_rendering(worn(), 0.0).step()


def test_the_image_weight_of_the_released_code_scales_the_shaded_image_alone() -> None:
    ours, theirs = (
        inverse_rendering(BALL, LATE, replace(weighing(similarity=0.0, squared=0.0), deviations=names)).step()
        for names in ((), ("image-weight",))
    )
    assert theirs["shaded"] == pytest.approx(ours["shaded"] / MaterialWeights().absolute, rel=1e-5)
    assert theirs["radiance"] == ours["radiance"]


def steps_of(variant: Variant) -> dict[str, float]:
    """The largest change of each raw parameter in a first step; positions in scene extents."""
    stage = inverse_rendering(worn(), LATE, variant, TINTED + SPECKLED)
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
    those drawn from the light have no floor.
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
