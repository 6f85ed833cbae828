"""Both stages on a device other than the host learn the same as on the host, and rarely wait for the device."""

from dataclasses import replace
from typing import get_args

import pytest
import torch

from cards import ON_CARD
from elsewhere import Account, There, elsewhere, registered
from known_ball import BALL
from known_ball import SCENE as BALL_SCENE
from radiogs.initialise import Initialisation
from radiogs.invert import InverseRendering
from radiogs.learning import MaterialLearning, MaterialStart
from radiogs.method import inverse_rendering
from radiogs.model import Model
from radiogs.relighting import relight
from radiogs.settings import Relighting, Variant
from radiogs_core.contract import Run
from radiogs_core.errors import NumericalFailure
from radiogs_core.instruments import recording
from radiogs_core.kernels.arrangement import cpu_as_cuda
from radiogs_core.learning.views import load
from radiogs_core.on_surfels.light_start import SharedRays, light_and_albedo
from radiogs_core.on_surfels.start_values import LightStart, StartValues
from radiogs_core.plain_values import with_values
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.surfels import Surfels
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import Sphere
from scenes import surfels_over
from short_training import BUDGET, CPU, SCENE, through_a_file

SHORT = with_values(
    BUDGET, {"geometry.steps": 10, "geometry.densify_interval": 4, "inverse_iterations": 6, "refresh_interval": 4}
)
MOST_WAITS = {"initialise": 3, "invert": 7}
"""Largest number of waits in a step without density control or a search for hidden surfels (docs/gpu.md)."""


@pytest.mark.parametrize("stage", ["initialise", "invert"])
@pytest.mark.parametrize("card", [pytest.param("cuda", marks=ON_CARD)])
def test_on_a_card_losses_fall_as_on_the_host(stage: str, card: str) -> None:
    """Random numbers and the order of sums differ on a card, so that the curves agree, but not the digits."""
    here, there = (last_loss(torch.device(each), stage) for each in ("cpu", card))
    assert there == pytest.approx(here, rel=0.2)


def last_loss(device: torch.device, stage: str) -> float:
    """Mean of all losses over the last steps of a stage."""
    first = Initialisation(Run(SCENE, Variant(), with_values(SHORT, {"geometry.steps": 60}), 0, device))
    losses = [sum(first.step().values()) for _ in range(first.iterations)]
    if stage == "invert":
        budget = replace(SHORT, inverse_iterations=40)
        second = inverse_rendering(Run(SCENE, Variant(), budget, 0, device), through_a_file(first.state()))
        losses = [sum(second.step().values()) for _ in range(second.iterations)]
    return sum(losses[-10:]) / 10


def trained(device: torch.device) -> dict[str, torch.Tensor]:
    """The tensors that both stages learn. The search for the light is left out: it amplifies rounding, and has its own
    test."""
    variant = Variant(materials=MaterialLearning(start=MaterialStart(light="constant")))
    first = Initialisation(Run(SCENE, variant, SHORT, 0, device))
    while first.iteration < first.iterations:
        first.step()
    second = inverse_rendering(Run(SCENE, variant, SHORT, 0, device), through_a_file(first.state()))
    while second.iteration < second.iterations:
        second.step()
    learnt = second.optimiser.tensors
    return {name: value.held if isinstance(value, There) else value.detach() for name, value in learnt.items()}


@pytest.mark.slow
def test_both_stages_learn_the_same_on_a_device_and_on_the_host() -> None:
    with cpu_as_cuda():
        expected = trained(CPU)
    with elsewhere():
        found = trained(registered())
    for name, value in expected.items():
        torch.testing.assert_close(found[name], value, rtol=1e-5, atol=1e-6, msg=name)


@pytest.mark.slow
def test_a_step_rarely_waits_for_the_device() -> None:
    def fewest(stage: Initialisation | InverseRendering, account: Account) -> int:
        found = []
        for _ in range(3):
            before = account.waits
            stage.step()
            found.append(account.waits - before)
        return min(found)

    long = with_values(SHORT, {"geometry.steps": 1000, "geometry.densify_interval": 500})
    with elsewhere() as account, recording():
        first = Initialisation(Run(SCENE, Variant(), long, 0, registered()))
        assert fewest(first, account) == MOST_WAITS["initialise"], account.awaited
        second = inverse_rendering(Run(SCENE, Variant(), SHORT, 0, registered()), through_a_file(first.state()))
        assert fewest(second, account) == MOST_WAITS["invert"], account.awaited


def moved(surfels: Surfels, device: torch.device) -> Surfels:
    return Surfels.of({name: value.to(device) for name, value in surfels.plain().items()})


def test_the_search_for_the_light_runs_on_the_surfels_device() -> None:
    """One step: where gradients cancel, Adam makes steps of rounding errors, which differ between devices."""

    def light_on(device: torch.device) -> torch.Tensor:
        views, generator = load(BALL_SCENE.train, device), torch.Generator(device).manual_seed(0)
        found = light_and_albedo(
            SharedRays(moved(BALL, device)), views, 8, StartValues(search=LightStart(steps=1)), generator
        )
        return found[0].cpu()

    with cpu_as_cuda():
        expected = light_on(CPU)
    with elsewhere():
        torch.testing.assert_close(light_on(registered()), expected, rtol=1e-4, atol=0)


@pytest.mark.parametrize("mode", get_args(Relighting))
def test_every_mode_of_relighting_runs_on_the_device(mode: Relighting) -> None:
    device = registered()
    with elsewhere():
        ball = surfels_over([Sphere((0.0, 0.0, 0.0), 1.0, Material((0.5, 0.4, 0.3), 0.5))], 0.4)
        model = Model(moved(ball, device), torch.zeros(8, 16, 3, device=device))
        run = Run(SCENE, Variant(relighting=mode), replace(SHORT, finetune_iterations=2), 0, device)
        relit = relight(model, EnvironmentMap(torch.ones(8, 16, 3)), torch.ones(3), run)
        image = relit.render(SCENE.test[0].camera.to(device, torch.float32))["image"]
        assert image.device.type == device.type
        assert bool(torch.isfinite(image).all())


def test_a_tensor_of_the_host_is_refused() -> None:
    with elsewhere():
        there = torch.ones(3, device=registered())
        with pytest.raises(AssertionError, match="of the device and of the host"):
            there + torch.ones(3)
        with pytest.raises(AssertionError, match="with a generator of cpu"):
            torch.rand(3, device=registered(), generator=torch.Generator())
        with pytest.raises(RuntimeError, match="numpy"):
            there.numpy()
        assert (there + 1).cpu().tolist() == [2.0, 2.0, 2.0]


def test_values_that_are_not_finite_are_named_on_a_device_too() -> None:
    with elsewhere():
        stage = Initialisation(Run(SCENE, Variant(), SHORT, 0, registered()))
        with torch.no_grad():
            stage.optimiser.tensors["opacity_logit"][3] = torch.nan
            stage.optimiser.tensors["centre"][5] = torch.nan
            stage.optimiser.tensors["sh"][7] = torch.nan
        with pytest.raises(NumericalFailure, match=r"'\w+' is not finite in stage 'initialise' at iteration 0"):
            stage.step()
