"""Whether a method keeps its contract, tested by training it (``radiogs-bench methods check NAME``)."""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor

from radiogs_core.contract import Method, NotOffered, Prepared, Run, Trained
from radiogs_core.errors import ExplainedError, NumericalFailure
from radiogs_core.plain_values import leaf_names, value_at, with_values
from radiogs_core.scene.colour import srgb_decode, srgb_encode
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene, View

from ..errors import Interrupted
from ..method_calls import calling, own_camera, own_light, refused
from ..scoring.rendering import on_black, prepared
from ..scoring.score_maps import truth
from ..store.folder import Store, product_name
from .cell import Work, cell_of
from .interruption import Interruption
from .progress import LogProgress
from .stages import Bench, Ledger, facts_of, trained

UNIT = 1e-2
"""Largest error of the length of a normal."""

CLEARLY = 3.0
"""Decibels by which the other colour space has to fit better to be named."""


@dataclass(frozen=True)
class Finding:
    """The outcome of one check."""

    verdict: Literal["holds", "fails", "note"]
    what: str
    """The observation, in one sentence."""
    remedy: str = ""
    """The next thing to do; empty without a fault."""


def judged(fault: str, remedy: str, holds: str) -> Finding:
    """The finding for a rule: its ``fault``, or the sentence ``holds`` if ``fault`` is empty."""
    return Finding("fails", fault, remedy) if fault else Finding("holds", holds)


@dataclass(frozen=True)
class _Training:
    """A model, the ledgers and products of its stages by name, and the steps that each has taken."""

    model: Trained
    ledgers: Mapping[str, Ledger]
    products: Mapping[str, Any]
    taken: Mapping[str, int]


def check_method(
    method: Method, scene: Scene, preset: str, device: torch.device, folder: Path, say: Callable[[str], None]
) -> Iterator[Finding]:
    """Train a method three times at a preset and render it; yields a finding for each rule of the contract.

    ``folder`` keeps files meanwhile. ``say`` receives progress as sentences. A call that raises is a finding, and ends
    the checks that need its outcome.
    """
    read = set[str]()
    run = Run(_watched(scene, read), method.variant(), method.presets[preset], 0, device)
    try:
        yield from _reads(method, run)
        say("training")
        first = _trained(method, run, folder / "first")
        yield _counted(method, run, first)
        yield _unread(read)
        say("training again, with the same seed")
        second = _trained(method, run, folder / "second")
        yield _same(first, second, "two trainings with the same seed", _SEED)
        say("training again, interrupted in the middle of each stage")
        resumed = _trained(method, run, folder / "resumed", interrupted=True)
        yield _same(first, resumed, "a training that is interrupted and one that is not", _STATE)
        say("rendering")
        yield from _check_model(method, run.scene, first.model, resumed.model, folder)
    except NumericalFailure as failure:  # what it tells of a kept state goes with the folder
        yield Finding("fails", failure.what, failure.why)
    except ExplainedError as error:
        yield Finding("fails", error.what, " ".join(filter(None, (error.why, error.remedy))))


_SEED = (
    "Seed every generator with run.seed, and use no operation whose result depends on the order of threads"
    " (torch.use_deterministic_algorithms names them)."
)
_STATE = (
    "state() has to hold all that step() changes: parameters, moments of the optimiser, schedules, generators; and"
    " restore() has to put all of it back."
)


def _watched(scene: Scene, read: set[str]) -> Scene:
    """A copy of the scene whose test views record in ``read`` which maps are read."""

    def source(view: View, name: str) -> Tensor:
        read.add(f"'{name}' of '{view.name}'")
        return view.read(name)

    test = (replace(view, sources={name: partial(source, view, name) for name in view.sources}) for view in scene.test)
    return replace(scene, test=tuple(test))


class _Steps(LogProgress):
    """Counts the steps of each stage by title; requests a stop in the middle of it through ``interruption``."""

    def __init__(self, interruption: Interruption | None) -> None:
        super().__init__()
        self.interruption = interruption
        self.taken = Counter[str]()

    def advance(self, task: str, done: int, total: int) -> None:
        """Count, and stop a stage once."""
        super().advance(task, done, total)
        if self.interruption is not None and 2 * self.taken[task] < total <= 2 * done:
            self.interruption.requested = True
        self.taken[task] = done


def _trained(method: Method, run: Run, folder: Path, *, interrupted: bool = False) -> _Training:
    """Train as a run does; if ``interrupted``, stages are stopped in the middle, and go on from their checkpoints."""
    try:
        cell = cell_of(method, run.scene, Work(run.variant, run.budget, run.seed, run.device.type))
    except ModuleNotFoundError as error:
        raise refused(method.name, f"its sources: {error}", "They name modules that can be imported.") from error
    store, interruption = Store(folder), Interruption()
    progress = _Steps(interruption if interrupted else None)
    bench = Bench(
        store, run.device, progress, interruption, lambda name: method, lambda scene: scene.checksum, math.inf
    )
    while True:
        try:
            model, ledgers = trained(bench, cell, run.scene)
            break
        except Interrupted:
            interruption.requested = False
    products = {stage.name: store.tensors(product_name(stage.key), run.device) for stage in cell.stages}
    return _Training(model, ledgers, products, {stage.name: progress.taken[stage.title] for stage in cell.stages})


def _reads(method: Method, run: Run) -> Iterator[Finding]:
    """The fields of variant and budget that no stage names in ``reads``."""
    with calling(method.name, "stages()"):
        kept = [spec.reads for spec in method.stages(run.variant, run.budget)]
    unread = []
    for what, values in (("variant", run.variant), ("budget", run.budget)):
        for name in leaf_names(values):
            other = _other(values, name)
            if other is None or (what, name) == ("budget", "name"):
                continue
            changed = replace(run, **{what: other})
            with calling(method.name, "stages()"):
                if [spec.reads for spec in method.stages(changed.variant, changed.budget)] == kept:
                    unread.append(f"{what} {name}")
    if unread:
        yield Finding(
            "note",
            f"no stage has in `reads`: {', '.join(unread)}",
            "Trainings that differ in these alone share one result: right for what restore() and prepare() alone read.",
        )
    else:
        yield Finding("holds", "every field of variant and budget is in the `reads` of a stage")


def _other(values: Any, name: str) -> Any:
    """Settings with another valid value of one field; None if no tried value is valid."""
    value = value_at(values, name)
    tried: tuple[Any, ...] = ()
    if isinstance(value, bool):
        tried = (not value,)
    elif isinstance(value, int | float):
        tried = (value + 1, value / 2, 2 * value)
    for each in tried:
        with suppress(ExplainedError):
            return with_values(values, {name: type(value)(each)})
    return None


def _counted(method: Method, run: Run, training: _Training) -> Finding:
    """Whether the number of steps is as announced, because the estimate of the time left uses it."""
    with calling(method.name, "stages()"):
        announced = {spec.name: spec.steps for spec in method.stages(run.variant, run.budget)}
    wrong = [f"'{name}' announces {steps}, takes {training.taken[name]}" for name, steps in announced.items()
             if training.taken[name] != steps]  # fmt: skip
    return judged(
        f"steps of stages: {'; '.join(wrong)}" if wrong else "",
        "StageSpec.steps and Stage.iterations have to be the same.",
        f"the steps of {len(announced)} stages are as many as announced",
    )


def _unread(read: set[str]) -> Finding:
    named = ", ".join(sorted(read)[:3]) + (", ..." if len(read) > 3 else "")
    return judged(
        f"training read the test views: {named}" if read else "",
        "Train on run.scene.train alone; cameras of scene.test may be used.",
        "training reads no image of a test view",
    )


def _same(first: _Training, second: _Training, what: str, remedy: str) -> Finding:
    """Whether two trainings agree bit for bit; if not, where they first differ."""
    for name, ledger in first.ledgers.items():
        for one, other in zip(_losses(ledger), _losses(second.ledgers[name]), strict=False):
            if one != other:
                return Finding("fails", f"{what} part at iteration {one[0]} of stage '{name}'", remedy)
        if where := difference(first.products[name]["product"], second.products[name]["product"]):
            return Finding("fails", f"{what} end with different product(){where} of stage '{name}'", remedy)
    return Finding("holds", f"{what} are the same to the last bit")


def _losses(ledger: Ledger) -> list[tuple[int, Mapping[str, float]]]:
    """Losses of the first steps, and their means between the points of the trail, by iteration."""
    return [(each["iteration"], each["losses"]) for each in (*ledger["first_steps"], *ledger["trail"])]


def _check_model(method: Method, scene: Scene, model: Trained, second: Trained, folder: Path) -> Iterator[Finding]:
    """Findings about the views of a trained model, under its own light and another one; ``second`` is its twin."""
    view = scene.test[0]
    facts_of(method.name, model)
    yield Finding("holds", "facts() are plain values")
    shown = prepared(method.name, model)
    maps = _maps(method, shown, view)
    yield Finding("holds", f"maps have the declared names, the camera's size and numbers: {', '.join(maps)}")
    yield _ranges(method, shown, view)
    if "image" not in maps:
        yield Finding("fails", "there is no map 'image'", "It is what every metric of new views compares.")
        return
    yield _colour_space(maps["image"], shown, view)
    for other in scene.test[1:2]:
        _maps(method, shown, other)
    yield _repeated(difference(maps, _maps(method, shown, view)), "a view rendered again, after another view")
    again = _maps(method, prepared(method.name, second), view)
    yield _repeated(difference(maps, again), "the model that restore() makes a second time")
    yield from _relit(method, view, model, maps)
    yield _repeated(difference(maps, _maps(method, prepared(method.name, model), view)), "a view after relighting")
    yield _exported(method, model, folder)


def _maps(method: Method, shown: Prepared, view: View) -> dict[str, Tensor]:
    return on_black(shown, view.camera, method=method.name, view=view.name)


def _ranges(method: Method, shown: Prepared, view: View) -> Finding:
    """Whether rendered values lie in the contract's ranges."""
    with calling(method.name, "render()"):
        maps = {name: image.detach().cpu() for name, image in shown.render(own_camera(view.camera)).items()}
    wrong = []
    for name, image in maps.items():
        finite = image[image.isfinite()]
        low, high = (float(finite.min()), float(finite.max())) if finite.numel() else (0.0, 0.0)
        top = 1.0 if name in ("image", "alpha", "roughness") else float("inf")
        linear = name == "image" and shown.offers[name].colour == "linear"
        if name != "normal" and not linear and (low < -1e-6 or high > top + 1e-6):
            wrong.append(f"{name} from {low:.3g} to {high:.3g}")
    if "normal" in maps:
        covered = maps["alpha"][..., 0] > 0.5 if "alpha" in maps else maps["normal"].abs().sum(-1) > 0
        error = (maps["normal"].norm(dim=-1) - 1).abs()[covered]
        if error.numel() and float(error.max()) > UNIT:
            wrong.append(f"normals of length {float(maps['normal'].norm(dim=-1)[covered].min()):.3g} and more")
    return judged(
        f"values outside of their range: {'; '.join(wrong)}" if wrong else "",
        "image, alpha and roughness lie in [0, 1], albedo, depth and radiance are not negative, normals are unit.",
        "values lie in their ranges",
    )


def _colour_space(image: Tensor, shown: Prepared, view: View) -> Finding:
    """Whether the image would fit the true one better in the other colour space than in the declared one."""
    target = truth(view, "image")
    other, name = (
        (srgb_encode(image), "linear") if shown.offers["image"].colour == "display" else (srgb_decode(image), "display")
    )
    declared, exchanged = (
        -10 * float((each.double() - target).square().mean().clamp(min=1e-12).log10()) for each in (image, other)
    )
    better = f"the image fits the true one by {exchanged - declared:.1f} dB better if its colours are taken for {name}"
    return judged(
        better if exchanged > declared + CLEARLY else "",
        f'Declare it MapKind("{name}") in `offers`, or render what is declared.',
        f"the image's colour space is the declared one ({declared:.1f} dB; the other: {exchanged:.1f})",
    )


def _repeated(where: str, what: str) -> Finding:
    return judged(
        f"{what} differs: map{where}" if where else "",
        "render() and prepare() may not change the model, nor draw unseeded numbers.",
        f"{what} has the same bits",
    )


def _relit(method: Method, view: View, model: Trained, maps: Mapping[str, Tensor]) -> Iterator[Finding]:
    """Check relighting: either declined in words, or a changed image whose brightness follows ``albedo_scale``."""
    light = EnvironmentMap(torch.rand(16, 32, 3, generator=torch.Generator().manual_seed(0)))
    images = []
    for factor in (1.0, 0.5):
        try:
            lit = prepared(method.name, model, own_light(light), torch.full((3,), factor))
        except NotOffered as refusal:
            yield Finding("note", f"relighting is not offered: {refusal.what}")
            return
        relit = _maps(method, lit, view)
        if "image" not in relit:
            yield Finding("fails", "a relit view has no map 'image'", "It is what every metric of relighting compares.")
            return
        images.append(relit["image"])
    use = "prepare(light) has to use its light."
    covered = "alpha" not in maps or float(maps["alpha"].max()) > 0.5
    if not (covered and maps["image"].any()):
        yield Finding("note", "the model shows nothing yet: relighting cannot be told", "Check at a larger --preset.")
    elif not images[0].any():
        yield Finding("fails", "a view under another light is black", use)
    elif torch.equal(images[0], maps["image"]):
        yield Finding("fails", "a view under another light is the view under its own", use)
    elif torch.equal(*images):
        scale = "Multiply the recovered albedo by albedo_scale before it is lit."
        yield Finding("fails", "relit views do not depend on albedo_scale", scale)
    else:
        yield Finding("holds", "another light and a factor of the albedo change the image")


def _exported(method: Method, model: Trained, folder: Path) -> Finding:
    place = folder / "export"
    place.mkdir(parents=True, exist_ok=True)
    with calling(method.name, "export()"):
        files = list(model.export(place))
    absent = [str(file) for file in files if not Path(file).is_file()]
    return judged(
        f"export() names files that are not there: {', '.join(absent)}" if absent else "",
        "Return the paths of the files that it wrote.",
        f"export() writes the {len(files)} files that it names",
    )


def difference(one: Any, other: Any) -> str:
    """The place of the first difference between two structures of tensors and plain values; empty if equal."""
    if isinstance(one, Tensor) and isinstance(other, Tensor):
        alike = one.shape == other.shape and one.dtype == other.dtype
        return "" if alike and bool(((one == other) | ((one != one) & (other != other))).all()) else " "
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        if one.keys() != other.keys():
            return " "
        return next(
            (f"[{name!r}]{found}".rstrip() for name in one if (found := difference(one[name], other[name]))), ""
        )
    if isinstance(one, list | tuple) and isinstance(other, list | tuple) and len(one) == len(other):
        pairs = enumerate(zip(one, other, strict=True))
        return next((f"[{number}]{found}".rstrip() for number, pair in pairs if (found := difference(*pair))), "")
    return "" if one == other or (one != one and other != other) else " "
