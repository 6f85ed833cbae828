"""A model that shows the ground truth of a scene, and scenes of known images for it."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import torch

from radiogs_bench.scoring.score_maps import truth
from radiogs_core.contract import MapKind
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene, View
from scenes import look_at

SIZE = 16


SCALE = torch.tensor([0.5, 2.0, 1.25])


def view_with(place: int, names: Mapping[str, int]) -> View:
    """A view whose maps are random, covered in its left three quarters, half of that by 60 %."""
    generator = torch.Generator().manual_seed(place)
    maps = {name: 0.1 + 0.4 * torch.rand(SIZE, SIZE, channels, generator=generator) for name, channels in names.items()}
    alpha = torch.zeros(SIZE, SIZE, 1)
    alpha[:, :12], alpha[:, :6] = 0.6, 1.0
    maps["alpha"] = alpha
    for name in maps:
        if name in ("direct", "indirect") or name.endswith("/indirect"):
            maps[name] = maps[name] * alpha
    if "normal" in maps:
        maps["normal"] = torch.nn.functional.normalize(maps["normal"], dim=-1) * (alpha > 0)
    camera = look_at(torch.tensor([4.0 + place, 0.0, 0.0]), torch.zeros(3), SIZE, 20.0)
    return View(f"view_{place}", camera, {name: (lambda image=image: image) for name, image in maps.items()})


EVERYTHING = {"image": 3, "albedo": 3, "normal": 3, "roughness": 1, "indirect": 3, "relit/sun": 3, "relit/sky": 3}


def scene_of(*views: View) -> Scene:
    lights = {name: EnvironmentMap(torch.full((2, 4, 3), level)) for name, level in (("sun", 1.0), ("sky", 0.5))}
    return Scene("s", "none", views, views, lights, None, "0")


KINDS = {
    "image": MapKind("display"),
    "alpha": MapKind("data"),
    **dict.fromkeys(("albedo", "indirect", "incident", "incident_direct"), MapKind("linear")),
    **dict.fromkeys(("normal", "roughness", "depth"), MapKind("data")),
}


class Perfect:
    """Shows the ground truth of a scene, but for what ``wrong`` adds to a map, and albedo divided by SCALE.

    ``light``: its recovered light; ``steps``: steps of preparing for another light.
    """

    timed = True

    def __init__(
        self,
        scene: Scene,
        wrong: Mapping[str, float] | None = None,
        light: EnvironmentMap | None = None,
        steps: int = 0,
    ) -> None:
        self.scene, self.wrong, self.light, self.steps = scene, dict(wrong or {}), light, steps
        self.scales: list[torch.Tensor] = []
        self.asked: list[str] = []

    def facts(self) -> dict[str, Any]:
        return {}

    def export(self, folder: Path) -> list[Path]:
        return []

    def prepare(
        self,
        light: EnvironmentMap | None = None,
        albedo_scale: torch.Tensor | None = None,
        after_step: Callable[[], None] = lambda: None,
    ) -> "Own | Relit":
        if light is None:
            return Own(self)
        assert albedo_scale is not None
        self.scales.append(albedo_scale)
        for _ in range(self.steps):
            after_step()
        return Relit(self, name_of(light, self.scene))

    def view(self, camera: Camera) -> View:
        views = (*self.scene.test, *self.scene.relight)
        return next(view for view in views if torch.equal(view.camera.centre, camera.centre))


def name_of(light: EnvironmentMap, scene: Scene) -> str:
    """The name of a light of the scene, of which a method is handed a copy."""
    return next(name for name, each in scene.lights.items() if torch.equal(each.radiance, light.radiance))


class Own:
    """Under its own light."""

    timed = True
    offers = KINDS
    default = frozenset(KINDS) - {"incident", "incident_direct"}

    def __init__(self, model: Perfect) -> None:
        self.model = model

    def render(self, camera: Camera, *further: str) -> dict[str, torch.Tensor]:
        view, wrong = self.model.view(camera), self.model.wrong
        self.model.asked += further
        maps = {name: torch.zeros(SIZE, SIZE, channels) for name, channels in EVERYTHING.items() if "/" not in name}
        maps |= {name: truth(view, name) for name in maps if view.has(name)}
        maps["albedo"] = maps["albedo"] / SCALE
        depth = truth(view, "depth") if view.has("depth") else torch.zeros(SIZE, SIZE, 1)
        maps |= {"alpha": view.read("alpha"), "depth": depth / 3}
        maps |= {name: torch.full((SIZE, SIZE, 3), 0.2) for name in ("incident", "incident_direct") if name in further}
        return {name: image + wrong.get(name, 0.0) for name, image in maps.items()}


class Relit:
    """The model under one of the scene's lights; it shows indirect light if the scene knows it."""

    timed = True
    offers: Mapping[str, MapKind] = {name: KINDS[name] for name in ("image", "alpha", "indirect")}
    default = frozenset(offers)

    def __init__(self, model: Perfect, light: str) -> None:
        self.model, self.name = model, f"relit/{light}"

    def render(self, camera: Camera, *further: str) -> dict[str, torch.Tensor]:
        view, indirect = self.model.view(camera), f"{self.name}/indirect"
        maps = {"image": truth(view, self.name) + self.model.wrong.get(self.name, 0.0), "alpha": view.read("alpha")}
        return maps | {"indirect": truth(view, indirect) if view.has(indirect) else torch.zeros(SIZE, SIZE, 3)}
