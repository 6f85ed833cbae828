"""Scenes that are hard for every method: a camera and a sky in exact numbers, and a miniature under hard conditions.

They are the scenes of suites ``stability`` and ``hard-training``. Under some conditions every metric should be that of
the miniature itself (``Condition.same``); under the others nothing can be learnt, and training, rendering and
relighting should end with finite values.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import torch
from torch import Tensor

from radiogs_core.scene.camera import Camera
from radiogs_core.scene.colour import srgb_decode, srgb_encode
from radiogs_core.scene.light import EnvironmentMap, texel_directions
from radiogs_core.scene.scene import Scene, View

from .reduction import with_long_side

BASE = "corner"
"""The miniature that every condition changes."""


@dataclass(frozen=True)
class Condition:
    """``says``: the condition in words. ``same``: whether the metrics should be those of ``BASE``."""

    says: str
    change: Callable[[Scene], Scene]
    same: bool = False


def hard_scene(name: str, base: Scene) -> Scene:
    """``BASE``, loaded as ``base``, under the condition of that name. Its true surfaces are not known."""
    changed = CONDITIONS[name].change(base)
    return replace(
        changed, name=name, checksum=f"{base.checksum}/{name}", points=None, surfaces=None, surfaces_by=(),
        loaders=(*base.loaders, __name__),
    )  # fmt: skip


def placed(scene: Scene, factor: float = 1.0, extents: float = 0.0) -> Scene:
    """The world scaled by ``factor`` and then moved by so many of its extents along each axis."""
    shift = extents * factor * scene.extent

    def moved(view: View) -> View:
        pose = view.camera.camera_to_world.double()
        pose[:3, 3] = pose[:3, 3] * factor + shift
        sources = dict(view.sources)
        if view.has("depth"):
            sources["depth"] = lambda: view.read("depth") * factor
        return replace(view, camera=replace(view.camera, camera_to_world=pose.float()), sources=sources)

    return scene.each_view(moved)


def painted(scene: Scene, value: float) -> Scene:
    """Training images of one colour, with their coverage."""

    def plain(view: View) -> View:
        return replace(view, sources={**view.sources, "image": lambda: torch.full_like(view.read("image"), value)})

    return replace(scene, train=tuple(map(plain, scene.train)))


def under_brighter_lights(scene: Scene, factor: float) -> Scene:
    """Lights for relighting ``factor`` times as bright, and the true relit images, clipped as displays clip them.

    Metrics of relit images then mean little: what covers a pixel by a millionth is white, too.
    """

    def brighter(view: View) -> View:
        def relit(read: Callable[[], Tensor]) -> Tensor:
            return srgb_encode((factor * srgb_decode(read())).clamp(0, 1))

        names = [name for name in view.sources if name.startswith("relit/") and name.count("/") == 1]
        indirect = {name for name in view.sources if name.startswith("relit/") and name.count("/") > 1}
        kept = {name: source for name, source in view.sources.items() if name not in indirect}
        return replace(view, sources=kept | {name: partial(relit, view.sources[name]) for name in names})

    lights = {name: EnvironmentMap(light.radiance * factor) for name, light in scene.lights.items()}
    return replace(scene.each_view(brighter), lights=lights)


def under_a_sun(scene: Scene, radiance: float) -> Scene:
    """Lights for relighting with one texel of ``radiance``, halfway up in the direction -X.

    True relit images are as under such bright lights: white wherever something is seen, because one bounce of this sun
    exceeds a display's range.
    """
    lights = {name: EnvironmentMap(light.radiance.clone()) for name, light in scene.lights.items()}
    for light in lights.values():
        light.radiance[light.radiance.shape[0] // 4, 0] = radiance
    return replace(under_brighter_lights(scene, radiance), lights=lights)


CONDITIONS: Mapping[str, Condition] = {
    "hard-scale-1e-4": Condition("the world 10,000 times smaller", lambda base: placed(base, 1e-4), same=True),
    "hard-scale-1e4": Condition("the world 10,000 times larger", lambda base: placed(base, 1e4), same=True),
    "hard-distance-1e3": Condition("1,000 extents from the origin", lambda base: placed(base, extents=1e3), same=True),
    "hard-bright-light": Condition("relit by a million times the light", lambda base: under_brighter_lights(base, 1e6)),
    "hard-sun": Condition("relit by a sun of radiance 1e6 in one texel", lambda base: under_a_sun(base, 1e6)),
    "hard-4-pixels": Condition("images of 4 x 4 pixels", lambda base: with_long_side(base, 4)),
    "hard-two-views": Condition(
        "two training views", lambda base: replace(base, train=base.train[:: len(base.train) // 2][:2])
    ),
    "hard-black": Condition("black training images", lambda base: painted(base, 0.0)),
    "hard-white": Condition("white training images", lambda base: painted(base, 1.0)),
}


HARD_CASES = "hard-cases"
WIDTH, HEIGHT, FOCAL = 16, 12, 16.0
SKY_HEIGHT = 16


def hard_cases() -> Scene:
    """A camera at the origin that looks along +z with the world's axes, and a sky that brightens towards +z.

    Powers of two all over: float64 sees the same camera as float32, to the last bit.
    """
    camera = Camera(torch.eye(4), FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT)
    upward = texel_directions(SKY_HEIGHT, 2 * SKY_HEIGHT)[..., 2:].float()
    sky = EnvironmentMap((0.25 + 0.125 * upward) * torch.tensor([0.75, 1.0, 1.25]))
    view = View(f"{HARD_CASES}_0", camera, {})
    checksum = f"{HARD_CASES}, {WIDTH} x {HEIGHT} pixels of 1 / {FOCAL}, sky of {SKY_HEIGHT} rows from 1/8 to 3/8"
    return Scene(HARD_CASES, "none", (view,), (view,), {}, sky, checksum)
