"""Stage 2 of GI-GS: which parameters its losses change and which they do not, and that it resumes bit for bit."""

from dataclasses import replace

import pytest
import torch

from baselines.methods.stage_two import GEOMETRY, GI_GS, tensors_of, with_values
from known_ball import BALL, COLOUR, SCENE, noise
from radiogs_baselines.methods.gi_gs.gbuffer import gbuffer, seen_materials
from radiogs_baselines.methods.gi_gs.settings import README_START, Budget, Variant
from radiogs_core.errors import UsageError
from radiogs_core.on_surfels.split_sum import SplitSumLight
from radiogs_core.transport.splitsum import PrefilteredLight


@pytest.mark.parametrize("scale", [0.0, 1.0])
def test_geometry_is_frozen_without_a_rate_and_radiance_always(scale: float) -> None:
    stage = GI_GS.stage_of(GI_GS.variant(lr_scale=scale))
    before = tensors_of(stage)
    for _ in range(4):
        stage.step()
    after = tensors_of(stage)
    for name in GEOMETRY:
        assert torch.equal(after[name], before[name]) == (scale == 0), name
    for name in ("sh", "sh_rest"):
        assert torch.equal(after[name], before[name]), name
    for name in ("albedo_logit", "roughness_logit", "log_environment"):
        assert not torch.equal(after[name], before[name]), name


def test_geometry_moves_at_its_share_of_the_final_rates_of_stage_one() -> None:
    stage = GI_GS.stage_of(GI_GS.variant(lr_scale=0.25))
    before, first = tensors_of(stage), Variant().geometry.rates
    stage.step()
    after = tensors_of(stage)
    rates = {
        "centre": first.position_end * SCENE.extent,
        "log_scale": first.end_share * first.scale,
        "opacity_logit": first.end_share * first.opacity,
    }
    for name, rate in rates.items():
        # Adam's first step is the rate itself.
        moved = float((after[name] - before[name]).abs().max())
        assert moved == pytest.approx(0.25 * rate, rel=0.03), name


@pytest.mark.parametrize(
    ("weight", "moved"),
    [
        ("shaded", {"albedo_logit", "roughness_logit", "metallic_logit", "log_environment"}),
        ("plainness", {"roughness_logit", "metallic_logit"}),
        ("light_smoothness", {"log_environment"}),
    ],
)
def test_each_loss_changes_the_parameters_it_depends_on(weight: str, moved: set[str]) -> None:
    """The variation loss has its own test below, because the ball's materials are smooth."""
    stage = GI_GS.stage_of(GI_GS.variant(materials=GI_GS.only(**{weight: 1.0}), lr_scale=0.0, metallic=True))
    light = 0.3 * torch.randn(8, 16, 3, generator=torch.Generator().manual_seed(0))
    before = tensors_of(with_values(stage, log_environment=light))
    stage.step()
    after = tensors_of(stage)
    assert {name for name, value in after.items() if not torch.equal(value, before[name])} == moved


@pytest.mark.parametrize("name", ["albedo_logit", "roughness_logit", "metallic_logit"])
def test_the_variation_loss_evens_out_a_material(name: str) -> None:
    stage = GI_GS.stage_of(GI_GS.variant(materials=GI_GS.only(variation=1.0), lr_scale=0.0, metallic=True))
    even = tensors_of(stage)[name]
    with_values(stage, **{name: even + noise(even, 1.0)})
    losses = [stage.step()["variation"] for _ in range(20)]
    assert sum(losses[-3:]) < 0.8 * sum(losses[:3]), "all three views, at the end and at the beginning"


def test_metalness_is_learnt_only_if_the_variant_says_so() -> None:
    plain, metal = (GI_GS.stage_of(GI_GS.variant(metallic=metallic)) for metallic in (False, True))
    assert "metallic_logit" not in plain.optimiser.tensors
    assert plain.model.metallic is None
    assert float(metal.model.metallic.detach().mean()) == pytest.approx(0.73)
    for _ in range(6):
        metal.step()
    assert float(metal.model.metallic.detach().mean()) < 0.73, "nothing shows metal, and it has its price"


def test_only_the_rate_of_albedo_decays() -> None:
    stage = GI_GS.stage_of(GI_GS.variant(lr_scale=0.0))
    rates = stage.variant.materials.rates

    def rate(name: str) -> float:
        return stage.optimiser.rates[name]

    stage.step()
    assert rate("albedo_logit") == pytest.approx(rates.albedo)
    stage.iteration = stage.iterations // 2
    stage.step()
    assert rate("albedo_logit") == pytest.approx((rates.albedo * rates.albedo_end) ** 0.5)
    assert rate("roughness_logit") == rates.roughness
    assert rate("log_environment") == rates.light


def test_every_training_view_shows_indirect_light() -> None:
    """Without hits the tests of this folder would only test the split sum."""
    stage = GI_GS.stage_of()
    for view in stage.views:
        model = stage.model
        seen = seen_materials(view.camera, model, model.surfels.albedo)
        maps = stage.shader.shade(
            gbuffer(view.camera, seen), seen.alpha, SplitSumLight(PrefilteredLight(model.environment))
        )
        assert float(maps["indirect"].detach().max()) > 0.01


@pytest.mark.parametrize("part", ["occlusion", "indirect", "sum", "masking", "start", "radius"])
def test_training_uses_the_shader_settings_of_the_variant(part: str) -> None:
    changed = {
        "occlusion": False, "indirect": False, "sum": "linear", "masking": "schlick", "start": 12, "radius": 0.1,
    }[part]  # fmt: skip
    assert GI_GS.stage_of(GI_GS.variant(**{part: changed})).step() != GI_GS.stage_of().step()


def test_materials_are_recovered_under_known_light_and_shape() -> None:
    """Under a light of 1 the ball sends COLOUR, so its albedo is COLOUR minus the lobe.

    The lobe is 0.013 seen from the front, and 0.03 where n.wo is 0.3.
    """
    learning = replace(
        GI_GS.constant,
        rates=replace(GI_GS.constant.rates, light=0.0, roughness=0.0, albedo_end=0.02),
        start=replace(GI_GS.constant.start, albedo=0.3),
    )
    stage = GI_GS.stage_of(GI_GS.variant(materials=learning, lr_scale=0.0), BALL)
    with_values(stage, log_environment=torch.zeros(8, 16, 3))
    for _ in range(100):
        stage.step()
    surfels = stage.model.surfels
    seen = (surfels.albedo - 0.3).abs().sum(-1) > 1e-3
    found = surfels.albedo[seen].median(0).values
    torch.testing.assert_close(found, torch.tensor(COLOUR) - 0.02, rtol=0, atol=0.01)


def test_a_constant_start_has_the_exposure_and_the_shared_start_is_searched() -> None:
    constant = GI_GS.stage_of().model
    assert torch.equal(constant.log_environment, constant.log_environment[:1, :1].expand(8, 16, 3))
    torch.testing.assert_close(constant.surfels.albedo, torch.full_like(constant.surfels.albedo, 0.73))
    torch.testing.assert_close(constant.surfels.roughness, torch.full_like(constant.surfels.roughness, 0.73))
    shared = GI_GS.stage_of(Variant(), BALL).model
    assert float(shared.log_environment.detach().std()) > 1e-3
    assert float(shared.surfels.albedo.detach().std()) > 1e-3


def test_a_grid_without_weighted_directions_is_refused() -> None:
    for name in ("heights", "render_heights"):
        with pytest.raises(UsageError, match=f"^{name}"):
            replace(GI_GS.budget, **{name: 2})
    assert isinstance(replace(GI_GS.budget, heights=3), Budget)


def test_the_march_of_the_readme_starts_beyond_its_end() -> None:
    assert Variant(readme_bug=True).training_start == README_START == 64
    assert Variant().training_start == 8
