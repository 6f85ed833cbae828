"""A trained TensoIR model, beside the properties of all methods that ``test_trained`` tests."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from baselines.methods.tensoir.world import looking_down
from baselines.methods.trained_models import FLOOR
from baselines.methods.trained_models import tensoir as trained
from radiogs_baselines.methods.tensoir.settings import Variant
from radiogs_core.scene.colour import srgb_encode

CAMERA = looking_down(size=5)


def test_maps_have_the_known_values_of_the_floor() -> None:
    maps = trained().prepare().render(CAMERA)
    whole = (CAMERA.height, CAMERA.width)
    torch.testing.assert_close(maps["alpha"], torch.ones(*whole, 1), rtol=1e-3, atol=0)
    torch.testing.assert_close(maps["albedo"], torch.full((*whole, 3), 0.4), rtol=1e-3, atol=0)
    torch.testing.assert_close(maps["roughness"], torch.full((*whole, 1), 0.54), rtol=1e-3, atol=0)
    torch.testing.assert_close(maps["normal"], torch.tensor([0.0, 0.0, 1.0]).expand(*whole, 3))
    # z-depth is the same in every pixel, though rays to the corners of this wide view are 15 % longer.
    wide = trained().prepare().render(replace(CAMERA, fx=5.0, fy=5.0))
    torch.testing.assert_close(wide["depth"], torch.full((*whole, 1), 1.4), rtol=0, atol=0.03)


def test_the_image_is_the_radiance_field_or_shaded() -> None:
    field = trained().prepare().render(CAMERA)
    torch.testing.assert_close(field["image"], srgb_encode(torch.full_like(field["image"], 0.3)), rtol=0, atol=2e-3)
    shaded = trained(Variant(shown="shaded")).prepare().render(CAMERA)
    torch.testing.assert_close(shaded["image"], srgb_encode(shaded["direct"] + shaded["indirect"]))
    assert not torch.allclose(shaded["image"], field["image"], atol=0.01)
    # A floor in light of 0.8: its albedo's part, and what the lobe adds.
    middle = shaded["direct"][2, 2]
    # The cosine's integral is exact for the middles of bands of equal height; the lobe's is 0.026 by these 32.
    torch.testing.assert_close(middle, torch.full((3,), 0.8 * (0.4 + 0.0262)), rtol=2e-3, atol=0)


def test_export_writes_all_parameters_and_the_box(tmp_path: Path) -> None:
    (path,) = trained().export(tmp_path)
    with np.load(path) as stored:
        assert set(stored) == {*FLOOR.parameters, "box_centre", "box_radius", "box_occupied"}
        for name, value in FLOOR.parameters.items():
            assert np.array_equal(stored[name], value.numpy())
        assert float(stored["box_radius"]) == FLOOR.box.radius
