"""Errors of recovered light on the surfaces that test views show, and the error that resolution alone costs."""

from dataclasses import replace

import pytest
import torch

from bench.fake_method import CPU
from bench.perfect import EVERYTHING, SIZE, Perfect, scene_of, view_with
from radiogs_bench.scoring.evaluate import evaluate
from radiogs_bench.scoring.metrics.conventions import Environment
from radiogs_bench.scoring.metrics.protocols import protocol
from radiogs_bench.scoring.recovered_light import (
    GLOSSY,
    PIXELS,
    SeenSurface,
    resolution_floor,
    score_light_on_surfaces,
    seen_surface,
)
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import View

RULES = protocol("default")
TINTED = torch.tensor([0.5, 2.0, 3.0])


def sunny(height: int, row: int, column: int) -> torch.Tensor:
    """A grey sky with a sun of one texel."""
    radiance = torch.full((height, 2 * height, 3), 0.2)
    radiance[row, column] = 100
    return radiance


def ball(roughness: float = 0.3) -> SeenSurface:
    """Points all over a ball; a mirror reflects each one's ray along the normal."""
    generator = torch.Generator().manual_seed(5)
    normals = torch.nn.functional.normalize(torch.randn(256, 3, dtype=torch.float64, generator=generator), dim=-1)
    return SeenSurface(normals, normals, torch.full((256, 1), roughness, dtype=torch.float64))


def errors(found: torch.Tensor, true: torch.Tensor, scale: str = "factor a channel") -> dict[str, float]:
    rules = replace(RULES, environment=Environment(scale))  # type: ignore[arg-type]
    scored = score_light_on_surfaces(rules, ball(), EnvironmentMap(found), EnvironmentMap(true))
    assert all(value.value is not None for value in scored.values())
    return {name: float(value.value or 0) for name, value in scored.items()}


def test_the_true_light_has_no_error_whatever_its_brightness_and_tint() -> None:
    true = sunny(16, 4, 7)
    assert max(errors(TINTED * true, true).values()) < 1e-9
    assert min(errors(TINTED * true, true, "one factor").values()) > 0.01
    doubled = errors(2 * true, true, "none")
    assert doubled == {"irradiance": pytest.approx(1), "reflection": pytest.approx(1)}


def test_a_light_that_is_turned_or_constant_is_wrong() -> None:
    true = sunny(16, 6, 7)
    turned, constant = errors(true.roll(8, 1), true), errors(torch.ones_like(true), true)
    assert min(turned["irradiance"], constant["irradiance"]) > 0.1
    assert min(turned["reflection"], constant["reflection"]) > 0.5


def test_a_coarse_map_of_a_sharp_sun_is_wrong_by_texels_and_right_by_irradiance() -> None:
    true = sunny(128, 40, 60)
    coarse = torch.nn.functional.avg_pool2d(true.movedim(-1, 0), 8).movedim(0, -1)
    assert float(resolution_floor(RULES, true, 16, 32).value or 0) > 0.85
    found = errors(coarse, true)
    assert found["irradiance"] < 0.01
    assert found["irradiance"] < found["reflection"] < 0.9


def test_at_its_own_resolution_a_map_has_no_floor() -> None:
    true = sunny(32, 10, 15)
    floors = [float(resolution_floor(RULES, true, rows, 2 * rows).value or 0) for rows in (32, 16, 8, 1)]
    assert floors[0] == pytest.approx(0, abs=1e-12)
    assert floors == sorted(floors)
    assert floors[1] > 0.3
    assert resolution_floor(RULES, torch.zeros(4, 8, 3), 4, 8).reason == "the true light is black"


def test_only_glossy_points_reflect() -> None:
    true, found, seen = sunny(16, 4, 7), sunny(16, 6, 9), ball()
    rough = seen.roughness.clone()
    rough[::2] = GLOSSY + 0.01
    some = replace(seen, roughness=rough)
    glossy = SeenSurface(seen.normals[1::2], seen.mirrored[1::2], seen.roughness[1::2])
    one, other = (
        score_light_on_surfaces(RULES, each, EnvironmentMap(found), EnvironmentMap(true)) for each in (some, glossy)
    )
    assert one["reflection"] == other["reflection"]
    assert one["irradiance"] != other["irradiance"]


def test_rougher_points_hide_more_of_an_error() -> None:
    true, found = EnvironmentMap(sunny(16, 4, 7)), EnvironmentMap(sunny(16, 5, 8))
    by_roughness = [
        float(score_light_on_surfaces(RULES, ball(rough), found, true)["reflection"].value or 0)
        for rough in (0.2, 0.35, 0.5)
    ]
    assert by_roughness == sorted(by_roughness, reverse=True)
    assert by_roughness[0] > 1.5 * by_roughness[2]


def facing(**maps: torch.Tensor) -> View:
    """A view along -X, from +X, whose centre shows a surface with the given normal."""
    view = view_with(0, {"image": 3})
    alpha = torch.zeros(SIZE, SIZE, 1)
    alpha[6:10, 6:10], alpha[0] = 1, 0.4
    sources = {"alpha": lambda: alpha} | {name: (lambda image=image: image) for name, image in maps.items()}
    return replace(view, sources=sources)


def test_points_are_the_covered_pixels_and_their_rays_are_mirrored_about_the_normal() -> None:
    normal = torch.tensor([0.6, 0.0, 0.8])
    seen = seen_surface([facing(normal=2 * normal.expand(SIZE, SIZE, 3), roughness=torch.full((SIZE, SIZE, 1), 0.3))])
    assert seen.normals.shape == (16, 3)
    torch.testing.assert_close(seen.normals, normal.double().expand(16, 3))
    torch.testing.assert_close(seen.roughness, torch.full((16, 1), 0.3).double())
    # A ray along (-1, 0, 0) leaves along (-1, 0, 0) + 1.2 (0.6, 0, 0.8).
    leaving = seen.mirrored.mean(0)
    torch.testing.assert_close(leaving, torch.tensor([-0.28, 0.0, 0.96]).double(), atol=0.01, rtol=0)


def test_the_views_share_a_bounded_number_of_pixels_evenly() -> None:
    size = 128
    solid = {"alpha": torch.ones(size, size, 1), "normal": torch.ones(size, size, 3)}
    view = replace(
        facing(),
        camera=replace(facing().camera, width=size, height=size),
        sources={name: (lambda image=image: image) for name, image in solid.items()},
    )
    assert len(seen_surface([view]).normals) == pytest.approx(PIXELS, rel=0.01)
    assert len(seen_surface([view] * 4).normals) == pytest.approx(PIXELS, rel=0.01)
    solid["alpha"][:, ::2] = 0
    assert len(seen_surface([view]).normals) == pytest.approx(PIXELS / 2, rel=0.05)


def reasons(**missing: torch.Tensor) -> tuple[str | None, str | None]:
    maps = {"normal": torch.ones(SIZE, SIZE, 3), "roughness": torch.full((SIZE, SIZE, 1), 0.3)} | missing
    seen = seen_surface([facing(**{name: image for name, image in maps.items() if image.numel()})])
    true = EnvironmentMap(sunny(4, 1, 3))
    found = score_light_on_surfaces(RULES, seen, true, true)
    return found["irradiance"].reason or None, found["reflection"].reason or None


def test_each_missing_value_gives_its_reason() -> None:
    nothing = torch.empty(0)
    unseen = "no test view shows a surface with a true normal"
    assert reasons() == (None, None)
    assert reasons(normal=nothing) == (unseen, unseen)
    assert reasons(alpha=torch.zeros(SIZE, SIZE, 1)) == (unseen, unseen)
    assert reasons(roughness=nothing) == (None, "no test view has a true roughness")
    matte = torch.full((SIZE, SIZE, 1), 0.51)
    assert reasons(roughness=matte) == (None, "no visible surface has a roughness of at most 0.5")
    black = EnvironmentMap(torch.zeros(4, 8, 3))
    found = score_light_on_surfaces(RULES, ball(), black, black)
    assert {each.reason for each in found.values()} == {"the true light is black"}


def test_evaluation_stores_all_three() -> None:
    true = EnvironmentMap(sunny(4, 1, 3))
    scene = replace(scene_of(*(view_with(place, EVERYTHING) for place in range(2))), training_light=true)
    found = evaluate(Perfect(scene, light=true), scene, RULES, CPU, lambda done, total: None).metrics
    for name in ("irradiance", "reflection", "floor"):
        assert found[f"environment/{name}"]["value"] == pytest.approx(0, abs=1e-9)


def test_a_scene_without_masks_has_neither_metric_and_gives_the_reason() -> None:
    view = view_with(0, EVERYTHING)
    bare = replace(view, sources={name: each for name, each in view.sources.items() if name != "alpha"})
    scene = replace(scene_of(view), train=(bare,), training_light=EnvironmentMap(sunny(4, 1, 3)))
    found = evaluate(Perfect(scene, light=scene.training_light), scene, RULES, CPU, lambda done, total: None).metrics
    for name in ("error_scaled", "irradiance", "reflection"):
        assert "no masks" in (found[f"environment/{name}"]["reason"] or "")
    assert "environment/floor" not in found
