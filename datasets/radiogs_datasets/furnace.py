"""Closed rooms whose radiance is known exactly: furnaces, for proving that no light is lost or made.

Where walls of one albedo, which scatter by albedo / pi alone, emit the same radiance E everywhere in all directions,
every wall sees nothing but walls, and the radiance is E / (1 - albedo) in the whole room, whatever its shape.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import torch

from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene, View
from radiogs_core.scene.surfaces import SurfaceSamples

from .generate.materials import Material
from .generate.solids import Box
from .generate.surfaces import surfaces_of

EMISSION = 0.1
"""Radiance that the walls emit: with it the brightest room below is not yet clipped in display colour."""

ALBEDOS: Mapping[str, float] = {"furnace-0.2": 0.2, "furnace-0.5": 0.5, "furnace-0.8": 0.8}

HALF_SIDE = 1.0
ROUGHNESS = 0.99
"""Roughness of the walls, which have no specular lobe; surfels have roughnesses below 1."""

SIZE = 64
FIELD_OF_VIEW = 90.0
TURNS = (0.3, 1.9)
"""Azimuths, in radian, of the two views from the middle of the room; neither is perpendicular to a wall."""


def furnace(name: str) -> Scene:
    """The room of that name around the origin: two views from within, with exact ``direct`` and ``indirect`` light.

    ``direct`` is the emitted, ``indirect`` the reflected radiance; there is no distant light.
    """
    views = tuple(_view(f"{name}_{place}", turn, ALBEDOS[name]) for place, turn in enumerate(TURNS))
    dark = EnvironmentMap(torch.zeros(2, 4, 3))
    return Scene(
        name, "furnace", views, views, {}, dark,
        checksum=f"{name}, emission {EMISSION}, side {2 * HALF_SIDE}",
        surfaces=partial(walls, ALBEDOS[name]),
    )  # fmt: skip


def walls(albedo: float, spacing: float, half_side: float = HALF_SIDE) -> SurfaceSamples:
    """Samples about ``spacing`` apart over the walls of a cube around the origin, which face inwards and emit light."""
    wall = Material((albedo, albedo, albedo), ROUGHNESS)
    box = surfaces_of([Box((-half_side,) * 3, (half_side,) * 3, wall)], spacing)
    first, second, normal = box.frame.unbind(-1)
    inwards, emission = torch.stack([second, first, -normal], -1), torch.full_like(box.centre, EMISSION)
    return replace(box, frame=inwards, size=box.size.flip(-1), emission=emission, specular=False)


def _view(name: str, turn: float, albedo: float) -> View:
    focal = SIZE / 2 / torch.tan(torch.deg2rad(torch.tensor(FIELD_OF_VIEW / 2))).item()
    angle = torch.tensor(turn)
    forward = torch.stack([angle.cos(), angle.sin(), torch.tensor(0.0)])
    right = torch.stack([angle.sin(), -angle.cos(), torch.tensor(0.0)])
    pose = torch.eye(4)
    pose[:3, :3] = torch.stack([right, torch.tensor([0.0, 0.0, -1.0]), forward], -1)
    camera = Camera(pose, focal, focal, SIZE / 2, SIZE / 2, SIZE, SIZE)
    sources = {
        "alpha": lambda: torch.ones(SIZE, SIZE, 1),
        "direct": lambda: torch.full((SIZE, SIZE, 3), EMISSION),
        "indirect": lambda: torch.full((SIZE, SIZE, 3), EMISSION * albedo / (1 - albedo)),
        # A ray leaves the cube through the wall that it reaches first.
        "depth": lambda: (HALF_SIDE / camera.ray_directions().abs()).min(-1, keepdim=True).values,
    }
    return View(name, camera, sources)
