"""A room without masks, made on the spot: a ball among painted walls, seen by cameras inside, in closed form."""

import math

import torch

from radiogs_core.scene.scene import Points, Scene, View
from scenes import look_at

BALL, WALLS = 0.5, 6.0
"""Radius of the ball in the middle, and half the side of the room, world units."""

DISTANCE = 2.0
"""How far the cameras are from the middle."""


def paint(point: torch.Tensor, waves: float) -> torch.Tensor:
    """A smooth pattern of display sRGB in (0, 1): ``waves`` radians a world unit."""
    phase = torch.tensor([0.0, 1.0, 2.0])
    return 0.5 + 0.2 * (waves * point + phase).sin() + 0.2 * (waves * point.roll(1, -1) + 2 * phase).cos()


def room_scene(views: int = 16, size: int = 32, masked: bool = False, points: int = 0) -> Scene:
    """Every fourth view is a test view. ``masked``: with coverage of 1 everywhere. ``points``: sparse ones, drawn over
    what the first training views show."""
    everything = tuple(_view(place, views, size, masked) for place in range(views))
    train = tuple(view for place, view in enumerate(everything) if place % 4)
    sparse = _sparse(train, points) if points else None
    return Scene("room", "synthetic", train, everything[::4], {}, None, "0" * 64, points=sparse)


def seen_points(view: View) -> torch.Tensor:
    """World points that the pixels of a view show, [height, width, 3]."""
    camera = view.camera
    rays = torch.nn.functional.normalize(camera.ray_directions(), dim=-1)
    origin = camera.centre.expand_as(rays)
    along = -(rays * origin).sum(-1)
    discriminant = along.square() - origin.square().sum(-1) + BALL**2
    ball = along - discriminant.clamp(min=0).sqrt()
    wall = ((WALLS * rays.sign() - origin) / torch.where(rays == 0, 1e-9, rays)).amin(-1)
    return origin + rays * torch.where(discriminant > 0, ball, wall)[..., None]


def _view(place: int, views: int, size: int, masked: bool) -> View:
    angle = 2 * math.pi * place / views
    position = DISTANCE * torch.tensor([math.cos(angle), math.sin(angle), 0.35 * math.sin(3 * angle)])
    bare = View(f"view_{place:03}", look_at(position, torch.zeros(3), size, 0.9 * size), {})
    shown = seen_points(bare)
    on_ball = shown.norm(dim=-1, keepdim=True) < 2 * BALL
    image = torch.where(on_ball, paint(shown, 6.0), paint(shown, 0.8))
    alpha = torch.ones(size, size, 1)
    return View(bare.name, bare.camera, {"image": lambda: image, **({"alpha": lambda: alpha} if masked else {})})


def _sparse(train: tuple[View, ...], count: int) -> Points:
    places = torch.cat([seen_points(view).flatten(0, 1) for view in train])
    colours = torch.cat([view.read("image").flatten(0, 1) for view in train])
    chosen = torch.randperm(len(places), generator=torch.Generator().manual_seed(0))[:count]
    return Points(places[chosen], colours[chosen])
