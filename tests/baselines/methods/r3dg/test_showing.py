"""A trained R3DG model, beside the properties of all methods that ``test_trained`` tests."""

from pathlib import Path

import numpy as np
import torch

from baselines.methods.r3dg.world import around
from baselines.methods.trained_models import HIGH_ROOF as ROOFED
from baselines.methods.trained_models import r3dg as trained
from known_ball import SCENE
from surfel_files import read_ply

CAMERA = SCENE.test[0].camera


def test_export_writes_the_surfels_and_the_local_light(tmp_path: Path) -> None:
    surfels, local = trained().export(tmp_path)
    torch.testing.assert_close(read_ply(surfels).albedo, ROOFED.albedo)
    np.testing.assert_array_equal(np.load(local), around(ROOFED, 0.2).numpy())
