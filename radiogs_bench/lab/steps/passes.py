"""One pass over everything that is measured: stages begun, steps of every kind, and relit frames."""

from collections.abc import Callable, Mapping
from copy import deepcopy
from functools import partial
from typing import Any, Protocol, TypeVar, runtime_checkable

import torch

from radiogs_core.capabilities import Relighting
from radiogs_core.contract import NotOffered, Prepared, Run, Stage, StageSpec
from radiogs_core.scene.light import EnvironmentMap

from ...method_calls import calling
from ...runs.stages import begun, close_stage, restored
from .subject import Subject, lay_on_surfaces

Result = TypeVar("Result")

AGAIN = 4
"""How often the last step of a stage is taken again: to begin a stage can take as long as a hundred of its steps."""


@runtime_checkable
class Observe(Protocol):
    """Watches one piece of work. ``titles``: what its seconds count as; empty for work that is not measured."""

    def __call__(self, titles: tuple[str, ...], work: Callable[[], Result]) -> Result:
        """Do the work; returns its result."""


def warm_up(subject: Subject) -> None:
    """Do everything once before anything is timed: kernels are compiled, and libraries loaded."""
    one_pass(subject, lambda titles, work: work())


def one_pass(subject: Subject, observe: Observe, stages: int | None = None) -> str:
    """Do everything once, or so many ``stages`` without relighting; returns where the model lies."""
    method = subject.method
    with calling(method.name, "stages()"):
        specs = method.stages(subject.short.variant, subject.short.budget)
    run = _run(subject, subject.short.variant)
    product: Mapping[str, Any] = {}
    lies = ""
    for index, spec in enumerate(specs[:stages]):
        begin = partial(begun, method.name, spec, run, product)
        stage = observe((f"{spec.title}: beginning",), begin)
        try:
            lies = lay_on_surfaces(stage, subject) if index == 0 else lies
            _steps(subject, spec, stage, observe)
            with calling(method.name, f"product() of stage '{spec.name}'"):
                product = dict(stage.product())
        finally:
            close_stage(method.name, stage)
    if stages is not None:
        return lies
    light = next(iter(subject.scene.lights.values()), None) or subject.scene.training_light
    for way in subject.short.relighting:
        _relit(subject, way, product, light, observe)
    return lies


def _run(subject: Subject, variant: Any) -> Run:
    return Run(subject.scene, variant, subject.short.budget, 0, subject.device, None)


def _steps(subject: Subject, spec: StageSpec, stage: Stage, observe: Observe) -> None:
    """Take steps of all kinds in their order; the first one sets things up and has no title."""
    kinds = subject.short.kinds[spec.name]

    def step(index: int) -> None:
        titles = tuple(f"{spec.title}: {kind.title}" for kind in kinds if index in kind.steps) if index else ()
        with calling(subject.method.name, f"step() of stage '{spec.name}'"):
            observe(titles, stage.step)

    last = max(max(kind.steps) for kind in kinds if kind.steps)
    for index in range(last):
        step(index)
    before = deepcopy(stage.state())  # a stage goes on in place
    step(last)
    for _ in range(AGAIN):
        with calling(subject.method.name, "restore()"):
            stage.restore(deepcopy(before))
        step(last)


def _relit(
    subject: Subject, way: Relighting, product: Mapping[str, Any], light: EnvironmentMap | None, observe: Observe
) -> None:
    """Prepare a way of relighting, and render the default maps of every test view; the first frame has no title."""
    model = restored(subject.method, _run(subject, way.variant), product)
    light = light or model.light

    def prepare() -> Prepared:
        with calling(subject.method.name, "prepare() for another light"):
            return model.prepare(light)

    title = f"relighting {way.title}"
    try:
        prepared = observe((f"{title}: preparing",), prepare)
    except NotOffered:
        return
    for index, view in enumerate(subject.scene.test):
        camera = view.camera.to(subject.device, torch.float32)
        with calling(subject.method.name, "render()"):
            observe((f"{title}: a frame",) if index else (), partial(prepared.render, camera))
