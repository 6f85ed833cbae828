"""A scene made on the spot: a shaded sphere seen from a ring of cameras, for tests that need a `Scene`."""

import math
from collections.abc import Sequence

import torch

from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap, texel_directions, texel_solid_angles
from radiogs_core.scene.scene import Scene, View
from radiogs_core.surfels.known_surfaces import surfels_on
from radiogs_core.surfels.surfels import Surfels, surfels_at
from radiogs_datasets.furnace import walls
from radiogs_datasets.generate.solids import Solid
from radiogs_datasets.generate.surfaces import surfaces_of


def look_at(position: torch.Tensor, target: torch.Tensor, size: int, focal: float) -> Camera:
    """A camera at ``position`` looking at ``target`` with the world's Z up."""
    forward = torch.nn.functional.normalize(target - position, dim=0)
    right = torch.nn.functional.normalize(torch.linalg.cross(forward, torch.tensor([0.0, 0.0, 1.0])), dim=0)
    down = torch.linalg.cross(forward, right)
    matrix = torch.eye(4)
    matrix[:3, :3] = torch.stack([right, down, forward], -1)
    matrix[:3, 3] = position
    return Camera(matrix, focal, focal, size / 2, size / 2, size, size)


def sun_and_sky(height: int) -> tuple[torch.Tensor, torch.Tensor]:
    """A sun of its real width, 0.53 degrees, 45 degrees high in a grey sky of radiance 0.1; and the direction to it.

    A surface that faces it receives an irradiance of 2 from it, six times the sky's.
    """
    direction = texel_directions(height, 2 * height)
    sun = direction[height // 4, height // 2]
    disc = ((direction @ sun) > math.cos(math.radians(0.53 / 2))).double()
    radiance = 2 / float((disc * texel_solid_angles(height, 2 * height)).sum())
    return (0.1 + radiance * disc)[..., None].repeat(1, 1, 3).float(), sun.float()


def surfels_facing(centre: torch.Tensor, normal: torch.Tensor) -> Surfels:
    """Grey opaque surfels, 0.1 wide, at ``centre`` with these unit normals. Not for a normal of -Z."""
    count = len(centre)
    surfels = surfels_at(centre, torch.full((count,), 0.1), centre + normal, torch.Generator().manual_seed(0))
    # The shortest rotation from +Z to n is the quaternion (1 + n_z, -n_y, n_x, 0).
    rotation = torch.stack([1 + normal[:, 2], -normal[:, 1], normal[:, 0], torch.zeros(count)], -1)
    surfels.rotation = torch.nn.functional.normalize(rotation, dim=-1)
    surfels.opacity_logit = torch.full((count,), 3.0)
    return surfels


def sphere_scene(views: int = 6, size: int = 16, scale: float = 1.0) -> Scene:
    """A unit sphere (times ``scale``) whose colour is its normal, white light, ``views`` cameras around it."""

    def view(place: int) -> View:
        angle = torch.tensor(2 * torch.pi * place / views)
        position = scale * torch.stack([4 * angle.cos(), 4 * angle.sin(), torch.tensor(1.0)])
        camera = look_at(position, torch.zeros(3), size, 1.4 * size)
        rays = torch.nn.functional.normalize(camera.ray_directions(), dim=-1)
        along = -(rays @ camera.centre)
        discriminant = along.square() - camera.centre.square().sum() + scale**2
        hit = discriminant > 0
        point = camera.centre + rays * (along - discriminant.clamp(min=0).sqrt())[..., None]
        image = torch.where(hit[..., None], point / scale * 0.4 + 0.5, 0.0)
        alpha = hit[..., None].float()
        return View(f"view_{place:03}", camera, {"image": lambda: image, "alpha": lambda: alpha})

    everything = tuple(view(place) for place in range(views))
    light = EnvironmentMap(torch.ones(4, 8, 3))
    return Scene("sphere", "synthetic", everything, everything[:2], {"white": light}, light, "0" * 64)


def surfels_over(solids: Sequence[Solid], spacing: float) -> Surfels:
    """Nearly opaque surfels about ``spacing`` apart all over the solids, with their materials; radiance grey 1/2."""
    return surfels_on(surfaces_of(solids, spacing))


def surfels_of_room(half_side: float, spacing: float, albedo: float) -> Surfels:
    """The inside of a closed cube around the origin."""
    return surfels_on(walls(albedo, spacing, half_side))
