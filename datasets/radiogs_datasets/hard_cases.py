"""The scene of suite ``stability``: a camera and a sky, exact in float32, and nothing else."""

import torch

from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap, texel_directions
from radiogs_core.scene.scene import Scene, View

NAME = "hard-cases"
WIDTH, HEIGHT, FOCAL = 16, 12, 16.0
SKY_HEIGHT = 16


def hard_cases() -> Scene:
    """A camera at the origin that looks along +z with the world's axes, and a sky that brightens towards +z.

    Powers of two all over: float64 sees the same camera as float32, to the last bit.
    """
    camera = Camera(torch.eye(4), FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT)
    upward = texel_directions(SKY_HEIGHT, 2 * SKY_HEIGHT)[..., 2:].float()
    sky = EnvironmentMap((0.25 + 0.125 * upward) * torch.tensor([0.75, 1.0, 1.25]))
    view = View(f"{NAME}_0", camera, {})
    checksum = f"{NAME}, {WIDTH} x {HEIGHT} pixels of 1 / {FOCAL}, sky of {SKY_HEIGHT} rows from 1/8 to 3/8"
    return Scene(NAME, "none", (view,), (view,), {}, sky, checksum)
