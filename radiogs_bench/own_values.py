"""Copies of a scene's values for a method, which may write into whatever it is handed."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from torch import Tensor

from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene, View

from .process_state import as_before


def own_scene(scene: Scene) -> Scene:
    """The scene with cameras, lights and points of its own; each map that it reads is a new tensor."""
    views: dict[int, View] = {}
    lights: dict[int, EnvironmentMap] = {}

    def own_view(view: View) -> View:
        return views.setdefault(id(view), _own_view(view))

    def light_of_its_own(light: EnvironmentMap) -> EnvironmentMap:
        return lights.setdefault(id(light), own_light(light))

    points = scene.points
    return replace(
        scene,
        train=tuple(map(own_view, scene.train)),
        test=tuple(map(own_view, scene.test)),
        relight=tuple(map(own_view, scene.relight)),
        lights={name: light_of_its_own(light) for name, light in scene.lights.items()},
        training_light=None if scene.training_light is None else light_of_its_own(scene.training_light),
        points=None if points is None else type(points)(points.positions.clone(), points.colours.clone()),
        options=dict(scene.options),
    )


def own_camera(camera: Camera) -> Camera:
    """A camera with a matrix of its own."""
    return replace(camera, camera_to_world=camera.camera_to_world.clone())


def own_light(light: EnvironmentMap) -> EnvironmentMap:
    """A light with radiance of its own."""
    return EnvironmentMap(light.radiance.clone())


def _own_view(view: View) -> View:
    sources = {name: partial(_read, read) for name, read in view.sources.items()}
    return replace(view, camera=own_camera(view.camera), sources=sources)


def _read(read: Callable[[], Tensor]) -> Tensor:
    """A map as a new tensor. Files are found from the harness's folder, wherever the method has gone."""
    with as_before():
        return read().clone()
