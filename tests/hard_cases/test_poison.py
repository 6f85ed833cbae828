"""Case 13: values that break arithmetic, in every slot of surfels, camera and light.

A poisoned scene must end in one of these ways: an error that names what is wrong; the image without the poisoned
primitive, to the last bit; the sound scene's image, if the value was never read (harmonics that no ray meets); or, if
it is one that the slot may take, the image that float64 makes of the same numbers. A NaN must not end in the last way.
"""

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from hard_cases.constructions import looking_along_z, raw_surfels, seen
from radiogs.model import Model
from radiogs.settings import Variant
from radiogs.showing import Renderer
from radiogs_core.errors import ExplainedError
from radiogs_core.kernels.surfel.footprint import PIXEL_FILTER_VARIANCE
from radiogs_core.kernels.surfel.geometry import (
    ALPHA_THRESHOLD,
    MAX_ALPHA,
    RASTER_TRANSMITTANCE_STOP,
    TRACE_TRANSMITTANCE_STOP,
)
from radiogs_core.kernels.trace.bvh import EMPTY
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.surfels import ROUGHNESS_FLOOR, Surfels

LARGEST = torch.finfo(torch.float32).max
POISONS = (
    math.nan, math.inf, -math.inf, 0.0, -0.0, 1e-45, -1e-45, 1e-38, -1e-38, 1e38, -1e38, LARGEST, -LARGEST, 1e10, 16.0,
    ALPHA_THRESHOLD, MAX_ALPHA, RASTER_TRANSMITTANCE_STOP, TRACE_TRANSMITTANCE_STOP, PIXEL_FILTER_VARIANCE, EMPTY,
    ROUGHNESS_FLOOR,
)  # fmt: skip
"""Twenty-two: no numbers, signed zeros, denormals, the ends of the range, and the code's own thresholds."""

LOGITS = ("opacity_logit", "albedo_logit", "roughness_logit")
"""Slots in which an infinity is a value like another: its sigmoid is 0 or 1."""

SURFEL_SLOTS = ("centre", "rotation", "log_scale", "sh", *LOGITS)
SLOTS = (*SURFEL_SLOTS, "pose", "lens", "light")
SEEDS = 23
"""10 slots x 22 values x 23 draws: 5,060 poisoned inputs."""

Maps = dict[str, Tensor]


def maps(surfels: Surfels, light: Tensor, camera: Camera) -> Maps:
    """Traced, shaded and splatted."""
    return Renderer(Model(surfels, light), 4, Variant()).render(camera)


def in_float64(surfels: Surfels, light: Tensor, camera: Camera) -> Maps:
    """The float64 pipeline on the same numbers: its range is so large that nothing here overflows."""
    wide = Surfels.of({name: value.double() for name, value in surfels.parameters().items()})
    return maps(wide, light.double(), camera.to(dtype=torch.float64))


def same_bits(first: Maps, second: Maps) -> bool:
    return all(torch.equal(first[name], second[name]) for name in first)


def same_numbers(found: Maps, exact: Maps) -> bool:
    """Within 2e-4, relative to the map's largest value; normals only where a surface is.

    The largest error of 10,120 inputs, 1.1e-4, comes from a coefficient of 1e38 where its harmonic is almost zero.
    """
    covered = exact["alpha"] > 1e-2
    return all(
        bool(torch.isfinite(found[name]).all())
        and float(((found[name].double() - wide) * covered).abs().max()) <= 2e-4 * max(1.0, float(wide.abs().max()))
        for name, wide in exact.items()
    )


def poisoned_camera(slot: str, value: float, entry: int) -> Camera:
    camera = looking_along_z(5, 4, focal=5.0)
    if slot == "lens":
        return replace(camera, **{("fx", "fy", "cx", "cy")[entry % 4]: value})
    matrix = camera.camera_to_world.clone()
    matrix[entry % 3, entry // 3 % 4] = value
    return replace(camera, camera_to_world=matrix)


def ending(slot: str, value: float, seed: int) -> str:
    """How one poisoned input ends; anything but the allowed ways fails the test."""
    torch.manual_seed(seed)
    surfels, light = raw_surfels(6, spread=0.5), 0.3 * torch.randn(3, 6, 3)
    surfels.opacity_logit = surfels.opacity_logit + 1
    camera = looking_along_z(5, 4, focal=5.0)
    entry = int(torch.randint(1_000_000, ()))
    numeric = (
        math.isfinite(value) or (slot in LOGITS and not math.isnan(value)) or (slot, value) == ("light", -math.inf)
    )
    sound, light_of_sound, victim = surfels, light, entry % 6
    try:
        if slot in SURFEL_SLOTS:
            field = getattr(surfels, slot).clone()
            row = field[victim].view(-1)
            row[entry // 6 % row.numel()] = value
            surfels = Surfels.of(surfels.parameters() | {slot: field})
        elif slot == "light":
            light = light.clone()
            light.view(-1)[entry % light.numel()] = value
        else:
            camera = poisoned_camera(slot, value, entry)
        found = maps(surfels, light, camera)
    except ExplainedError as error:
        return f"named: {error.what.split()[0]}"
    if numeric and same_numbers(found, in_float64(surfels, light, camera)):
        return "as float64"
    if slot in SURFEL_SLOTS:
        # Unseen instead of gone: the directions of the others are drawn in the order of all.
        opacity = sound.opacity_logit.clone()
        opacity[victim] = -math.inf
        if same_bits(found, maps(Surfels.of(sound.parameters() | {"opacity_logit": opacity}), light, camera)):
            return "left out"
    if slot in (*SURFEL_SLOTS, "light") and same_bits(found, maps(sound, light_of_sound, camera)):
        return "never read"
    pytest.fail(f"{value} in {slot} (seed {seed}) is neither named, nor left out, nor right")


@pytest.mark.slow
@pytest.mark.case(13)
@pytest.mark.parametrize("slot", SLOTS)
def test_poison_is_named_left_out_or_right(slot: str) -> None:
    """Five hundred inputs of each slot."""
    endings = [ending(slot, value, seed) for seed in range(SEEDS) for value in POISONS]
    assert len(set(POISONS)) == 21, "twenty-two values, of which the two zeros are equal"
    assert len(endings) * len(SLOTS) == 5_060
    assert len(set(endings)) > 1 or slot == "pose", f"every value in {slot} ends alike: {endings[0]}"


@pytest.mark.case(13)
@pytest.mark.parametrize("slot", SURFEL_SLOTS)
def test_gradients_of_sound_surfels_survive_a_poisoned_one_or_it_is_named(slot: str) -> None:
    """Backward: a NaN that is never met pulls on nobody; one that is met makes the loss NaN, which training names."""
    camera = looking_along_z(5, 4, focal=5.0)
    for seed, value in enumerate(POISONS):
        torch.manual_seed(seed)
        surfels = raw_surfels(6, spread=0.5)
        getattr(surfels, slot)[2].view(-1)[0] = value
        leaves = {name: tensor.clone().requires_grad_() for name, tensor in surfels.parameters().items()}
        image = torch.cat([part.flatten() for part in seen(camera, Surfels.of(leaves))])
        if not bool(torch.isfinite(image).all()):
            continue
        image.sum().backward()
        sound = torch.tensor([0, 1, 3, 4, 5])
        for name, leaf in leaves.items():
            if leaf.grad is not None:
                assert bool(torch.isfinite(leaf.grad[sound]).all()), f"{value} in {slot}: gradient to {name}"
