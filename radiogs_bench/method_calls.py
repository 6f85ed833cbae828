"""Calls methods by unknown authors: their exceptions become failures that name the method, their results are checked.

A method's mistake is not the harness's. It ends its own cell alone, and the message tells the method's author what was
called and what happened. Methods get copies of their arguments, because they may write into them.
"""

import math
import signal
import traceback
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import replace
from functools import partial
from typing import Any

import torch
from torch import Tensor

from radiogs_core.errors import ExplainedError
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene, View

from .errors import MethodFailed, StoppedAtOnce
from .process_state import as_before, set_apart

FRAMES = 2
"""Traceback frames that are shown: the raising one and its caller."""

CONTRACT = "What a method is: docs/your_method.md and radiogs_core.contract"

LEAVES = (type(None), bool, int, float, complex, str, bytes, bytearray, torch.Size, torch.dtype, torch.device)
BRANCHES = (list, tuple, set, dict, OrderedDict, Counter)
"""Types besides tensors that PyTorch reads back from a file without running code from it."""


@contextmanager
def calling(method: str, what: str) -> Iterator[None]:
    """Wraps a call into a method, such as ``step() of stage 'fit'``: exceptions become MethodFailed.

    ExplainedError and the user's Ctrl-C pass through. ``SystemExit`` and other exceptions outside ``Exception`` become
    failures, too: a method that gives up ends its own cell. Changes of the process's state hold for its own calls
    (``process_state``).
    """
    with set_apart(method, what):
        try:
            yield
        except BaseException as error:
            if isinstance(error, ExplainedError) or stops_at_once(error):  # by the method's handlers of signals
                raise
            first = _words_of(error).splitlines()[:1]
            inside = traceback.extract_tb(error.__traceback__)[2:]  # behind this frame and the method's caller
            told = [*traceback.format_list(inside[-FRAMES:]), *traceback.format_exception_only(error)]
            raise MethodFailed(
                f"{method} failed in {what}: {': '.join([type(error).__name__, *first])}",
                "".join(told).rstrip(),
                trace="".join(traceback.format_exception(error)),
            ) from error


def stops_at_once(error: BaseException) -> bool:
    """Whether an exception is the user's stop, by a second Ctrl-C in a run or by Python's default handler."""
    if isinstance(error, StoppedAtOnce):
        return True
    return isinstance(error, KeyboardInterrupt) and signal.getsignal(signal.SIGINT) is signal.default_int_handler


def _words_of(error: BaseException) -> str:
    """The text of an exception; making it may raise as well."""
    try:
        return str(error)
    except Exception as wrong:  # noqa: BLE001  anything may come from a stranger's __str__
        return f"(its text raises {type(wrong).__name__})"


def refused(method: str, what: str, why: str) -> MethodFailed:
    """The failure of a method that returned something other than its contract states."""
    return MethodFailed(f"{method}: {what}", why, CONTRACT)


def members(contract: type) -> tuple[str, ...]:
    """Names of the members of a protocol of ``radiogs_core.contract``, in its order."""
    named = [*getattr(contract, "__annotations__", {}), *vars(contract)]
    return tuple(name for name in dict.fromkeys(named) if not name.startswith("_"))


def lacking(given: object, contract: type) -> list[str]:
    """Names of a protocol's members that an object lacks; properties are not evaluated."""
    return [name for name in members(contract) if not hasattr(type(given), name) and not hasattr(given, name)]


def require(method: str, given: object, contract: type, source: str) -> None:
    """Raise MethodFailed for an object that lacks members of a protocol; ``source`` names the object's origin."""
    missing = lacking(given, contract)
    if missing:
        raise refused(
            method,
            f"what {source} gave lacks {', '.join(missing)}",
            f"It is a {type(given).__name__}; a {contract.__name__} has {', '.join(members(contract))}.",
        )


def losses_of(method: str, given: Any, stage: str) -> dict[str, float]:
    """The losses that ``step`` returned, by name; tensors of one element become numbers."""
    if not isinstance(given, Mapping):
        raise refused(
            method,
            f"step() of stage '{stage}' returned a {type(given).__name__}",
            "It has to return the losses by name, such as {'image': 0.1}; {} where there are none.",
        )
    losses = {}
    for name, value in given.items():
        try:
            losses[str(name)] = float(value.detach() if isinstance(value, Tensor) else value)
        except (TypeError, ValueError, OverflowError, RuntimeError) as error:
            raise refused(
                method,
                f"loss '{name}' of stage '{stage}' is a {type(value).__name__}",
                f"It has to be a number: {error}.",
            ) from error
    return losses


def not_finite(losses: Mapping[str, float]) -> list[str]:
    """Names and values of losses that are NaN or infinite, as text."""
    return [f"'{name}' is {value}" for name, value in losses.items() if not math.isfinite(value)]


def require_storable(method: str, content: Mapping[str, Any], source: str, stage: str) -> None:
    """Raise MethodFailed for a value that could be written but not read again, naming its place in ``source``."""
    try:
        found = _unstorable(content, "")
    except RecursionError:
        found = ("", "structure that holds itself, or is nested too deep")
    if found is not None:
        where, kind = found
        raise refused(
            method,
            f"{source}{where} of stage '{stage}' is a {kind}",
            "What is stored is tensors, numbers, strings, and lists, tuples, sets and dicts of them; an array becomes a"
            " tensor by torch.from_numpy, a NumPy number a number by .item().",
        )


def _unstorable(value: Any, where: str) -> tuple[str, str] | None:
    if isinstance(value, Tensor) or type(value) in LEAVES:
        return None
    if type(value) not in BRANCHES:
        return where, f"{type(value).__module__}.{type(value).__name__}"
    if isinstance(value, Mapping):
        inner = [(key, f"{where}, a key") for key in value]
        inner += [(each, f"{where}[{key!r}]") for key, each in value.items()]
    else:
        inner = [(each, f"{where}[{number}]") for number, each in enumerate(value)]
    return next((found for each in inner if (found := _unstorable(*each)) is not None), None)


def own_scene(scene: Scene) -> Scene:
    """A copy of the scene with its own cameras, lights and points; each map is read as a new tensor."""
    views = {id(view): _own_view(view) for view in (*scene.train, *scene.test, *scene.relight)}
    train, test, relight = (
        tuple(views[id(view)] for view in group) for group in (scene.train, scene.test, scene.relight)
    )
    return replace(
        scene,
        train=train,
        test=test,
        relight=relight,
        lights={name: own_light(light) for name, light in scene.lights.items()},
        training_light=None if scene.training_light is None else own_light(scene.training_light),
        points=deepcopy(scene.points),
        options=dict(scene.options),
    )


def own_camera(camera: Camera) -> Camera:
    """A copy of a camera with its own matrix."""
    return replace(camera, camera_to_world=camera.camera_to_world.clone())


def own_light(light: EnvironmentMap) -> EnvironmentMap:
    """A copy of a light with its own radiance."""
    return EnvironmentMap(light.radiance.clone())


def _own_view(view: View) -> View:
    sources = {name: partial(_own_map, read) for name, read in view.sources.items()}
    return replace(view, camera=own_camera(view.camera), sources=sources)


def _own_map(read: Callable[[], Tensor]) -> Tensor:
    """A map as a new tensor. Paths resolve from the harness's folder, whatever folder the method has entered."""
    with as_before():
        return read().clone()
