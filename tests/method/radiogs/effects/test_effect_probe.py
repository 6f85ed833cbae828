"""Probes of surfels with a known answer, and of adversarial scenes: no needed effect is switched off altogether."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import pytest
import torch
from scipy.spatial.transform import Rotation

from probed_scenes import CLAY, FLOOR, SAMPLES, found, grey, seen, sky
from radiogs.effects.assessment import Assessment, image_gradient
from radiogs.effects.plan_radiance import PlanRadiance
from radiogs.effects.probe import accepted_plan
from radiogs.effects.probe_scene import SHARP_ROUGHNESS, ProbeView
from radiogs.effects.step_cost import Step
from radiogs.effects.tolerance import Tolerance
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.sampling import tangent_frame
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import Box, Sphere
from scenes import surfels_over


def pit() -> Surfels:
    """Eight upright surfels, 12 cm across and 10 cm high, that face each other over the middle of the floor."""
    angle = torch.arange(8, dtype=torch.float64) * (2 * math.pi / 8)
    outwards = torch.stack([angle.cos(), angle.sin(), torch.zeros_like(angle)], -1)
    quaternion = Rotation.from_matrix(tangent_frame(-outwards).numpy()).as_quat(scalar_first=True)
    one = surfels_over([FLOOR], 0.4).take(torch.zeros(8, dtype=torch.long))
    centre = (0.06 * outwards + torch.tensor([0.0, 0.0, 0.05])).float()
    size = torch.full((8, 2), 0.03).log()
    changed = {"centre": centre, "rotation": torch.from_numpy(quaternion).float(), "log_scale": size}
    return Surfels.of(one.parameters() | changed)


def test_a_cavity_of_a_few_surfels_keeps_its_rays() -> None:
    """0.3 % of the surfels stand around a pit of two pixels, for a method with a PSNR of 28 dB.

    At 46 dB, the surfels in its faint shadow, seven of its radii wide, would keep their rays too.
    """
    floor, ring = surfels_over([FLOOR], 0.05), pit()
    assert len(ring) / len(floor) < 0.004
    combined = {name: torch.cat([value, ring.parameters()[name]]) for name, value in floor.parameters().items()}
    made = seen(Surfels.of(combined), sky(), noise=0.04)
    plan = found(made).plan
    assert plan.traces
    if plan.traced is not None:
        # The ring also occludes the sky for the floor around it: all traced surfels lie there.
        near = made.surfels.centre.norm(dim=-1) < 0.2
        assert bool(plan.traced[near].any())
        assert not bool(plan.traced[~near].any())
        assert float(plan.traced.float().mean()) < 0.1


def test_without_a_difference_between_images_a_gradient_keeps_the_rays() -> None:
    """The black table occludes only the black part of the sky for the floor, so that V changes no image. But without V
    the floor would give gradient to a part of the light that it cannot see."""
    floor = Box((-0.35, -0.35, -0.1), (0.35, 0.35, 0.0), CLAY)
    table = Box((-0.45, -0.45, 0.8), (0.45, 0.45, 0.85), Material((0.02, 0.02, 0.02), 0.9))
    light = sky()
    light[:5] = 1e-6  # more than 39 degrees high; the table's rim is at 45 degrees or higher
    made = seen(grey(surfels_over([floor, table], 0.12), 0.0), light)
    # All images are a tenth too bright, so that all gradients have one sign.
    darker = tuple(ProbeView(view.camera, 0.9 * view.target) for view in made.views if view.target is not None)
    made = dataclasses.replace(made, views=darker)
    record = found(made).evidence[0]
    assert record.effect == "visibility"
    assert record.measured.bound < 0.05
    assert record.measured.gradient > 0.25
    assert "gradients" in record.why
    assert record.verdict == "on"


def test_a_lobe_that_smoother_surfaces_would_show_is_kept_while_roughness_is_learnt() -> None:
    """While roughness is learnt, the lobe at a low roughness counts too; for final materials it does not."""
    rough = surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, Material((0.9, 0.9, 0.9), 0.98))], 0.12)
    final = seen(rough, sky(sun=8.0), noise=0.1)
    learning = dataclasses.replace(final, sharpest=SHARP_ROUGHNESS)
    assert found(learning, effects=("specular",)).plan.specular
    assert not found(final, effects=("specular",)).plan.specular


def test_zero_harmonics_are_left_out_and_others_are_kept() -> None:
    ball = grey(surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, CLAY)], 0.08), 0.4)
    made = seen(ball, sky())
    assert found(made, effects=("view-dependence",)).plan.sh_degree == 0
    ball.sh[:, 2] = 0.3
    assert found(seen(ball, sky()), effects=("view-dependence",)).plan.sh_degree == 1


def test_larger_masks_change_the_radiance_more() -> None:
    table = Box((-0.5, -0.5, 0.4), (0.5, 0.5, 0.45), CLAY)
    made = seen(surfels_over([FLOOR, table], 0.12), sky())
    radiance = PlanRadiance(made)
    full = radiance.shaded(EffectPlan()).detach()
    masks = [made.occlusion > edge for edge in (0.05, 0.2, 0.4)]
    reduced = [radiance.shaded(EffectPlan(traced=mask)).detach() for mask in masks]
    changes = [float((each - full).square().mean()) for each in reduced]
    assert changes == sorted(changes)
    everywhere = EffectPlan(traced=torch.ones(len(made.surfels), dtype=torch.bool))
    assert torch.equal(radiance.shaded(everywhere).detach(), full)


def test_a_probe_repeats_for_its_seed() -> None:
    ball = surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, CLAY)], 0.15)
    assert found(seen(ball, sky())).evidence == found(seen(ball, sky())).evidence


def test_the_image_gradient_reaches_visible_surfels_alone() -> None:
    """It is zero for surfels that face away from the camera, and not for all."""
    ball = surfels_over([Sphere((0.0, 0.0, 0.0), 0.8, CLAY)], 0.25)
    made = seen(ball, sky())
    pull = image_gradient(PlanRadiance(made))
    assert float(pull.abs().max()) > 0
    behind = (PlanRadiance(made).outgoing * made.surfels.frame[:, None, :, 2]).sum(-1) < -0.2
    assert not pull[behind].any()


@pytest.mark.parametrize("refused", [{"visibility", "indirect"}, {"visibility", "indirect", "samples"}])
def test_effects_that_save_least_return_if_the_combination_costs_too_much(refused: set[str]) -> None:
    """The assessment refuses a plan that leaves out all of ``refused``; each effect alone passes."""
    local = EffectPlan(traced=torch.arange(100) < 30)
    chosen = {
        "visibility": local,
        "indirect": EffectPlan().without("indirect"),
        "samples": EffectPlan().without("samples"),
    }

    class TogetherTooMuch(Assessment):
        def __init__(self) -> None:
            self.step, self.seed, self.tolerance = Step(100, 50, SAMPLES, 10), 0, Tolerance(1e-3)

        def measure(self, reductions: Sequence[tuple[str, EffectPlan]]) -> list[Any]:
            return [None] * len(reductions)

        def decided(self, effect: str, plan: EffectPlan, measured: Any, before: EffectPlan) -> tuple[Any, str, Any]:
            left_out = {
                name
                for name, out in (
                    ("visibility", plan.traced is not None),
                    ("indirect", not plan.indirect),
                    ("samples", plan.samples > 1),
                )
                if out
            }
            return ("on" if refused <= left_out else "off", "", None)

    plan, record, left = accepted_plan(TogetherTooMuch(), chosen, EffectPlan(), 7)
    assert set(left) == {"visibility", "samples"}
    assert plan.indirect
    assert plan.traced is local.traced
    assert plan.samples == 2
    assert (record.verdict, record.iteration) == ("off", 7)
