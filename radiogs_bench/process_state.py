"""Isolates global state of the process (working folder, seeds, default types) between methods.

A method that changes the working folder, PyTorch's default type or the seeds keeps its changes for its own calls. The
harness and other rows' methods find the previous values.
"""

import locale
import logging
import os
import random
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
import torch

from .errors import StoreError

logger = logging.getLogger(__name__)

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

SEED = 0
"""Seed of the process's random generators at the beginning of every row, for methods that do not seed them."""

DENORMAL = np.float32(1e-40)


class Part(NamedTuple):
    """A part of the process's state: ``read`` returns its present value, comparable, and ``write`` sets it."""

    read: Callable[[], Any]
    write: Callable[[Any], object]


def _folder() -> str | None:
    try:
        return os.getcwd()
    except FileNotFoundError:  # somebody deleted it
        return None


def _set_environment(wanted: Mapping[str, str]) -> None:
    for name in os.environ.keys() - wanted.keys():
        del os.environ[name]
    os.environ.update(wanted)


def _torch_numbers() -> tuple[bytes, ...]:
    states = [torch.get_rng_state(), *(torch.cuda.get_rng_state_all() if torch.cuda.is_initialized() else ())]
    return tuple(state.numpy().tobytes() for state in states)


def _set_torch_numbers(states: tuple[bytes, ...]) -> None:
    first, *devices = (torch.frombuffer(bytearray(state), dtype=torch.uint8) for state in states)
    torch.set_rng_state(first)
    if torch.cuda.is_initialized() and not devices:  # nothing had been drawn there when the state was taken
        torch.cuda.manual_seed_all(SEED)
    for index, state in enumerate(devices):
        torch.cuda.set_rng_state(state, index)


def _numpy_numbers(generator: Any = np.random) -> tuple[Any, ...]:
    kind, key, *rest = generator.get_state()  # whoever uses the old functions has them put back
    return kind, key.tobytes(), *rest


def _set_numpy_numbers(state: tuple[Any, ...]) -> None:
    kind, key, *rest = state
    np.random.set_state((kind, np.frombuffer(key, np.uint32), *rest))  # noqa: NPY002


def _arithmetic() -> tuple[Any, ...]:
    return (
        torch.get_float32_matmul_precision(),
        torch.backends.cudnn.allow_tf32,
        torch.backends.cudnn.benchmark,
        torch.backends.cudnn.deterministic,
        bool(DENORMAL * np.float32(1) == 0),
    )


def _set_arithmetic(wanted: tuple[Any, ...]) -> None:
    precision, tf32, benchmark, deterministic, flush = wanted
    torch.set_float32_matmul_precision(precision)
    torch.backends.cudnn.allow_tf32 = tf32
    torch.backends.cudnn.benchmark, torch.backends.cudnn.deterministic = benchmark, deterministic
    torch.set_flush_denormal(flush)


def _set_filters(wanted: list[Any]) -> None:
    warnings.resetwarnings()  # also forgets which warnings were shown before
    warnings.filters[:] = wanted  # type: ignore[index]


def _set_handlers(wanted: tuple[Any, ...]) -> None:
    if threading.current_thread() is not threading.main_thread():
        return  # nothing but the main thread may set them, so a method in this one has not
    for which, handler in zip(SIGNALS, wanted, strict=True):
        if handler is not None:  # of a library in C, which Python cannot set
            signal.signal(which, handler)


def _set_streams(wanted: tuple[Any, Any]) -> None:
    sys.stdout, sys.stderr = wanted


def _set_path(wanted: list[str]) -> None:
    sys.path[:] = wanted


PARTS: Mapping[str, Part] = {
    "the working folder": Part(_folder, lambda folder: os.chdir(folder) if folder else None),
    "environment variables": Part(lambda: dict(os.environ), _set_environment),
    "where modules are looked for": Part(lambda: list(sys.path), _set_path),
    "PyTorch's default type": Part(torch.get_default_dtype, torch.set_default_dtype),
    "PyTorch's default device": Part(
        torch.get_default_device, lambda device: torch.set_default_device(None if device.type == "cpu" else device)
    ),
    "PyTorch's number of threads": Part(torch.get_num_threads, torch.set_num_threads),
    "whether PyTorch keeps gradients": Part(torch.is_grad_enabled, torch.set_grad_enabled),
    "PyTorch's deterministic algorithms": Part(
        lambda: (torch.are_deterministic_algorithms_enabled(), torch.is_deterministic_algorithms_warn_only_enabled()),
        lambda given: torch.use_deterministic_algorithms(given[0], warn_only=given[1]),
    ),
    "PyTorch's precision and denormal numbers": Part(_arithmetic, _set_arithmetic),
    "PyTorch's random numbers": Part(_torch_numbers, _set_torch_numbers),
    "NumPy's random numbers": Part(_numpy_numbers, _set_numpy_numbers),
    "Python's random numbers": Part(random.getstate, random.setstate),
    "how NumPy prints": Part(np.get_printoptions, lambda given: np.set_printoptions(**given)),
    "NumPy's treatment of errors": Part(np.geterr, lambda given: np.seterr(**given)),
    "filters of warnings": Part(lambda: list(warnings.filters), _set_filters),
    "handlers of signals": Part(lambda: tuple(map(signal.getsignal, SIGNALS)), _set_handlers),
    "the locale": Part(lambda: locale.setlocale(locale.LC_ALL), lambda given: locale.setlocale(locale.LC_ALL, given)),
    "standard output and errors": Part(lambda: (sys.stdout, sys.stderr), _set_streams),
}
"""The parts by their names in messages."""

UNSAID = ("Python's random numbers",)
"""Parts whose changes are not reported: libraries of all kinds draw from these generators."""

State = dict[str, Any]
"""Values of some parts by their names."""


def _read() -> State:
    return {name: part.read() for name, part in PARTS.items()}


def _move(now: State, wanted: State) -> None:
    """Set the parts in which ``wanted`` differs from ``now``. Raises StoreError if a part cannot be set."""
    for name, value in wanted.items():
        try:
            if now[name] != value:
                PARTS[name].write(value)
        except (OSError, RuntimeError, ValueError, TypeError) as error:
            raise StoreError(
                f"{name} cannot be set back to what it was before a method changed it: {error}",
                "Other rows would be run under what that method left.",
                "Run the same command again without that method.",
            ) from error


ours: set[str] = set()
"""Names of methods that come with the harness. Their calls are not isolated, which would cost 0.3 ms each: they take
seeds and settings as arguments."""

_loaded: dict[str, State] = {}
"""Parts of the state that importing a method's package has changed, by method; they hold in each of its rows."""

_own: dict[str, State] = {}
"""Parts that a method has changed in its present row, the imports included, by method."""

_said: set[tuple[str, str]] = set()

_before: list[State] = []
"""The harness's state at each open call into a method, the innermost last."""


def begin_row() -> None:
    """Forget changes by methods in earlier rows: each row begins with the state after the package's import."""
    _own.clear()


def _new_row(method: str) -> State:
    """The parts of the state that differ from the harness's when a row begins: by imports, and seeds."""
    return {
        "PyTorch's random numbers": (torch.Generator().manual_seed(SEED).get_state().numpy().tobytes(),),
        "NumPy's random numbers": _numpy_numbers(np.random.RandomState(SEED)),
        "Python's random numbers": random.Random(SEED).getstate(),
        **_loaded.get(method, {}),
    }


@contextmanager
def set_apart(method: str, what: str, loading: bool = False) -> Iterator[None]:
    """Run a call into a method under its own state, and restore the harness's afterwards.

    A changed part is logged once, by name; ``what`` is the call in that message, such as ``step()``. ``loading``: the
    call imports the method's package, and what it changes holds in all rows of the method.
    """
    if method in ours:
        yield
        return
    before = _read()
    _before.append(before)
    own = _own[method] if method in _own else _own.setdefault(method, _new_row(method))
    _move(before, own)
    entered = {**before, **own}
    try:
        yield
    finally:
        _before.pop()
        after = _read()
        changed = {name: value for name, value in after.items() if value != before[name]}
        _move(after, before)
        own.clear()
        own.update(changed)
        if loading:
            _loaded[method] = dict(changed)
        told = [name for name, value in changed.items() if value != entered[name] and name not in UNSAID]
        new = [name for name in told if (method, name) not in _said]
        if new:
            _said.update((method, name) for name in new)
            logger.warning(
                "%s changed %s in %s; this holds for its own calls, and is undone for everything else",
                method, ", ".join(new), what,
            )  # fmt: skip


@contextmanager
def as_before() -> Iterator[None]:
    """Run what a method calls back under the state before the call; unchanged without an open call."""
    if not _before:
        yield
        return
    inside = _read()
    _move(inside, _before[-1])
    try:
        yield
    finally:
        _move(_read(), inside)
