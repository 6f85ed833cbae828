"""Stage 2 of GI-GS, beside the properties of all methods that ``test_stage_two`` tests."""

import pytest

from baselines.methods.stage_two import GI_GS
from radiogs_baselines.methods.gi_gs.gbuffer import gbuffer, seen_materials
from radiogs_baselines.methods.gi_gs.settings import README_START, Budget, Variant
from radiogs_core.errors import UsageError
from radiogs_core.on_surfels.split_sum_light import SplitSumLight
from radiogs_core.transport.prefiltered_light import PrefilteredLight


def test_metalness_is_learnt_only_if_the_variant_sets_it() -> None:
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


def test_a_grid_without_weighted_directions_is_refused() -> None:
    for name in ("heights", "render_heights"):
        with pytest.raises(UsageError, match=f"^{name}"):
            GI_GS.numbered(**{name: 2})
    assert isinstance(GI_GS.numbered(heights=3), Budget)


def test_the_march_of_the_readme_starts_beyond_its_end() -> None:
    assert Variant(readme_bug=True).training_start == README_START == 64
    assert Variant().training_start == 8
