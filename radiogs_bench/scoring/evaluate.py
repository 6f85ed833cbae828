"""Scores a trained model: its maps of the test views, the relit views, and the recovered light."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.capabilities import RelitByReference
from radiogs_core.contract import NotOffered, Prepared, Trained
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene, View

from ..errors import MethodFailed
from ..initial_viewpoint import initial_viewpoint
from ..method_calls import calling, own_camera, own_light, refused, require
from ..process_state import as_before
from ..store.provenance import peaks_within, wait_for
from ..store.schema import MetricValue
from .metrics.protocol import Protocol
from .metrics.values import Value
from .metrics_by_view import MetricsByView
from .recovered_light import score_constant_light, score_light, withhold_light
from .rendering import Maps, frame_milliseconds, view_on_black
from .report_arrays import ARRIVING, ReportArrays, surfel_arrays
from .score_maps import (  # fmt: skip
    against_reference,
    compared_indirect,
    coverage,
    lit_views,
    mean_roughness,
    score_albedo,
    score_constant_roughness,
    score_depth,
    score_view,
    truth,
    without_reference,
)

Advance = Callable[[int, int], None]


@dataclass(frozen=True)
class Scope:
    """Measurements besides scores."""

    timed: bool = True
    """Whether milliseconds and memory of a frame are measured."""
    kept_views: int | None = 0
    """Number of views whose maps are kept as 8-bit codes (``ReportArrays``); None: as many as fit a limit."""
    surfels: bool = True
    """Whether the model's surfels, and paths of light between them, are kept for the reports."""
    reference: bool = False
    """Whether relit views are also compared with views in the method's reference mode (``RelitByReference``)."""


TIMED = Scope()
SCORES_ALONE = Scope(timed=False, surfels=False)


@dataclass(frozen=True)
class Evaluation:
    """The measurements of a trained model: fields of a result (``store.schema.Result``), and arrays."""

    metrics: dict[str, MetricValue]
    timings: dict[str, MetricValue]
    views: list[str]
    shown_view: str
    shown_light: str | None
    albedo_scale: list[float] | None
    arrays: dict[str, np.ndarray]
    """See ``ReportArrays`` and ``surfel_arrays``."""
    protocol: dict[str, Any]
    maps: list[str] = field(default_factory=list)
    recovered: dict[str, float] = field(default_factory=dict)


def evaluate(
    trained: Trained,
    scene: Scene,
    rules: Protocol,
    device: torch.device,
    advance: Advance,
    scope: Scope = TIMED,
    method: str = "the method",
) -> Evaluation:
    """Score a model on every test view, and on every relit ground-truth image of the scene.

    ``advance`` is called with (done, total) images after each one and between the steps of a long preparation; it may
    raise to stop. ``method``: its name in messages. Relighting, light and albedo of a scene without masks are n/a.

    Raises DataError for a damaged ground-truth map, MethodFailed for an exception of the method and for a map that does
    not keep to its contract, NumericalFailure for an image that is not finite.
    """
    rules = rules.on(scene.layout)
    evaluator = _Evaluator(scene, rules, device, advance, scope, method)
    evaluator.show_own(evaluator.prepared(trained))
    evaluator.compare_light(trained)
    scale = evaluator.compare_whole()
    evaluator.relight(trained, torch.ones(3) if scale is None else rules.relighting_scale(scale))
    withhold_light(evaluator.scores, scene)
    report, roughness = evaluator.report, evaluator.roughness
    seen_from = initial_viewpoint(scene, report.shown.camera)
    return Evaluation(
        metrics=evaluator.scores.metrics(),
        timings=evaluator.costs.metrics(),
        views=list(evaluator.scores.views),
        shown_view=report.shown.name,
        shown_light=report.shown_light,
        albedo_scale=None if scale is None else scale.tolist(),
        arrays=report.arrays | (surfel_arrays(trained, seen_from, scene.lights) if scope.surfels else {}),
        protocol=rules.describe(),
        maps=sorted(evaluator.given),
        recovered={"roughness": math.fsum(roughness) / len(roughness)} if roughness else {},
    )


@dataclass
class _Evaluator:
    """An evaluation in progress: what has been scored and kept so far."""

    scene: Scene
    rules: Protocol
    device: torch.device
    advance: Advance
    scope: Scope
    method: str
    kept: dict[str, Maps] = field(default_factory=dict)
    given: set[str] = field(default_factory=set)
    roughness: list[float] = field(default_factory=list)
    memory: dict[str, int] = field(default_factory=dict)
    done: int = 0

    def __post_init__(self) -> None:
        scene = self.scene
        names = ([view.name for view in views] for views in (scene.test, scene.relight))
        self.scores = MetricsByView(self.rules, *names)
        self.costs = MetricsByView(self.rules, *self.scores.groups)
        self.lit = {} if scene.surrounded else lit_views(scene, (*scene.test, *scene.relight))
        self.report = ReportArrays(scene, self.lit, self.scope.kept_views)
        self.total = len(scene.test) + sum(map(len, self.lit.values()))

    def still_there(self) -> None:
        """Report progress during a method's long preparation; a request to stop takes effect here."""
        with as_before():
            self.advance(self.done, self.total)

    def count(self) -> None:
        """Count one more scored image."""
        self.done += 1
        self.advance(self.done, self.total)

    def prepared(
        self, trained: Trained, light: EnvironmentMap | None = None, albedo_scale: Float[Tensor, "3"] | None = None
    ) -> Prepared:
        """The model under its own light, or under another one."""
        what = "prepare()" if light is None else "prepare() for another light"
        ours: list[Exception] = []

        def after_step() -> None:
            try:
                self.still_there()
            except Exception as error:
                ours.append(error)
                raise

        try:
            with calling(self.method, what):
                ready = trained.prepare(
                    None if light is None else own_light(light),
                    None if albedo_scale is None else albedo_scale.clone(),
                    after_step,
                )
        except MethodFailed:
            if ours:  # it came from the harness, through the method
                raise ours[-1] from None
            raise
        require(self.method, ready, Prepared, what)
        return ready

    def rendered(self, prepared: Prepared, view: View, *further: str) -> dict[str, Tensor]:
        """The maps of a view, on black, on the CPU."""
        return view_on_black(prepared, view, self.device, *further, method=self.method)

    def measure(self, task: str, prepared: Prepared, views: Sequence[View]) -> None:
        """Measure ``task/ms`` of each view and ``task/megabytes`` (10^6 bytes), the largest peak of any frame.

        Memory is the peak of the CUDA allocator on a GPU, including what the model keeps between frames; on a CPU it is
        the resident set of the whole process, including libraries and the scene's images.
        """
        if not (self.scope.timed and prepared.timed):
            return
        cameras = [own_camera(view.camera.to(self.device, torch.float32)) for view in views]
        with calling(self.method, "render(), once more to be timed"), peaks_within(self.device) as peaks:
            times = frame_milliseconds(prepared.render, cameras, self.device)
        for view, milliseconds in zip(views, times, strict=True):
            self.costs.add(task, view.name, {"ms": Value(milliseconds)})
        self.memory[task] = max(self.memory.get(task, 0), peaks.get("device", peaks["host"]))
        self.costs.add_whole(task, {"megabytes": Value(self.memory[task] / 1e6)})

    def show_own(self, prepared: Prepared) -> None:
        """Score every test view under the recovered light, and keep the maps that are compared over all views."""
        whole = ("albedo", "alpha") if self.rules.depth is None else ("albedo", "alpha", "depth")
        for view in self.scene.test:
            wanted = {compared_indirect(self.rules), *(ARRIVING if view is self.report.shown else ())}
            maps = self.rendered(prepared, view, *(name for name in ARRIVING if name in wanted & {*prepared.offers}))
            self.given |= maps.keys()
            score_view(self.scores, view, maps, self.scene.extent)
            if (roughness := mean_roughness(view, maps)) is not None:
                self.roughness.append(roughness)
            self.report.add(view, maps)
            self.kept[view.name] = {name: maps[name] for name in whole if name in maps}
            self.count()
        self.measure("nvs", prepared, self.scene.test)

    def compare_light(self, trained: Trained) -> None:
        """Score the recovered light if the model has one and the true light is known."""
        with calling(self.method, "light"):
            light = trained.light
        if light is None:
            return
        if not isinstance(light, EnvironmentMap):
            raise refused(
                self.method, f"its light is a {type(light).__name__}", "It has to be an EnvironmentMap, or None."
            )
        self.given.add("environment")
        score_light([self.scores], self.scene, light)
        score_constant_light(self.scores, self.scene)
        self.report.add_light(light)

    def compare_whole(self) -> Float[Tensor, "3"] | None:
        """Score what is compared over all views: depth, albedo, constants; returns the albedo's factor per channel."""
        if "roughness" in self.given:
            score_constant_roughness(self.scores, self.scene)
        score_depth(self.scores, self.scene, self.kept)
        scale = score_albedo(self.scores, self.scene, self.kept)
        self.report.add_albedo(self.kept, scale)
        return scale

    def relight(self, trained: Trained, albedo_scale: Float[Tensor, "3"]) -> None:
        """Score the relit views of each light, with the albedo multiplied by ``albedo_scale``."""
        prepared_in: list[float] = []
        for light, views in self.lit.items():
            started = time.perf_counter()
            try:
                relit = self.prepared(trained, self.scene.lights[light], albedo_scale)
            except NotOffered as cannot:
                self._withhold_relit(views, cannot.what)
                continue
            wait_for(self.device)
            if relit.timed:
                prepared_in.append(1e3 * (time.perf_counter() - started))
            self.measure("render", relit, views)
            reference = self._reference(trained, light, albedo_scale)
            for view in views:
                maps = self.rendered(relit, view)
                self._score_relit(light, view, maps)
                if self.scope.reference:
                    self.scores.add("relight", view.name, self._against(reference, view, maps))
                self.count()
        if self.scope.timed and prepared_in:
            self.costs.add_whole("prepare", {"ms": Value(math.fsum(prepared_in) / len(prepared_in))})

    def _reference(self, trained: Trained, light: str, albedo_scale: Float[Tensor, "3"]) -> Prepared | None:
        """The model under a light in its method's reference mode, if that is requested and offered."""
        if not (self.scope.reference and isinstance(trained, RelitByReference)):
            return None
        with calling(self.method, "reference()"):
            ready = trained.reference(own_light(self.scene.lights[light]), albedo_scale.clone(), self.still_there)
        require(self.method, ready, Prepared, "reference()")
        return ready

    def _against(self, reference: Prepared | None, view: View, maps: Maps) -> dict[str, Value]:
        """Metrics of a relit view against the same view in the reference mode."""
        if reference is None or "image" not in maps:
            return without_reference(f"{self.method} has no reference of relighting")
        return against_reference(maps["image"], self.rendered(reference, view)["image"], coverage(view))

    def _withhold_relit(self, views: Sequence[View], reason: str) -> None:
        for view in views:
            self.scores.add("relight", view.name, self.rules.no_comparison(reason))
            if self.scope.reference:
                self.scores.add("relight", view.name, without_reference(reason))
            self.count()

    def _score_relit(self, light: str, view: View, maps: Maps) -> None:
        if "image" not in maps:
            self.scores.add("relight", view.name, self.rules.no_comparison(f"{self.method} renders no relit image"))
            return
        image, target, mask = maps["image"], truth(view, f"relit/{light}"), coverage(view)
        self.scores.add("relight", view.name, self.rules.score_image(image, target, mask, maps.get("alpha"), "relight"))
        known = "indirect" in maps and view.has(f"relit/{light}/indirect")
        self.report.add_relit(view, light, maps, target, indirect=known and compared_indirect(self.rules) == "indirect")


def few_views(scene: Scene, count: int) -> Sequence[View]:
    """At most ``count`` test views, evenly spread over their list."""
    return scene.test[:: -(-len(scene.test) // count)]
