"""A method's mistake ends its own cell, and the message tells its author what went wrong and where."""

import asyncio
import math
import os
import pickle
import random
import signal
import sys
import warnings
from collections import Counter, OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from bench.chain_method import Chain, ChainPrepared, ChainStage, ChainTrained, Turned
from radiogs_bench import installed_methods, methods
from radiogs_bench.cli import main
from radiogs_bench.cli.reporter import complain
from radiogs_bench.errors import MethodFailed, exit_code, explain
from radiogs_bench.method_calls import calling, lacking, losses_of, members, own_scene, require, require_storable
from radiogs_bench.process_state import begin_row
from radiogs_bench.runs.cell import Cell, Work, cell_of
from radiogs_bench.runs.engines.in_process import Task, run_cells
from radiogs_bench.runs.interruption import Interruption
from radiogs_bench.runs.preflight import compile_kernels
from radiogs_bench.runs.progress import LogProgress
from radiogs_bench.runs.scene_checksum import checksum_now
from radiogs_bench.runs.stages import Bench, facts_of
from radiogs_bench.runs.train import train_and_score
from radiogs_bench.scoring.rendering import on_black
from radiogs_bench.store.folder import Store
from radiogs_bench.whole_runs import explained_code
from radiogs_core.contract import MapKind, Method, NotOffered, Prepared, Run, Stage, Trained
from radiogs_core.errors import ExplainedError, NumericalFailure, UsageError
from scenes import sphere_scene

CPU = torch.device("cpu")
SCENE = sphere_scene(views=2, size=16)


class Wrong(Chain):
    """A chain whose second stage, or whose model, does something wrong: ``what`` by the method that it replaces."""

    def __init__(self, **what: Callable[..., Any]) -> None:
        super().__init__(("coarse", "fine"), name="wrong")
        self.what = what

    def stages(self, *given: Any) -> Any:
        specs = super().stages(*given)
        begin = specs[1].begin

        def begin_wrong(run: Any, before: Mapping[str, Any]) -> Any:
            stage = begin(run, before)
            for name in ("step", "state", "product"):
                if name in self.what:
                    setattr(stage, name, self.what[name])
            return stage

        object.__setattr__(specs[1], "begin", begin_wrong)
        return specs

    def restore(self, *given: Any) -> Any:
        model = super().restore(*given)
        for name in ("facts", "prepare"):
            if name in self.what:
                setattr(model, name, self.what[name])
        return model


def fails(kind: type[BaseException], *with_what: Any) -> Callable[..., Any]:
    def raise_it(*given: Any) -> Any:
        raise kind(*with_what)

    return raise_it


def run_all(store: Store, *chains: Chain, seeds: int = 1, **how: float) -> list[ExplainedError]:
    """Run the cells of some methods; returns why some failed. ``how``: fields of the bench."""
    found = {chain.name: chain for chain in chains}
    bench = Bench(store, CPU, LogProgress(), Interruption(), found.__getitem__, checksum_now, **how)
    tasks = [Task(cell, cell.key) for chain in chains for cell in cells_of(chain, seeds)]
    return run_cells(tasks, lambda cell: train_and_score(bench, cell, SCENE), store, bench.progress, bench.interruption)


def cells_of(chain: Chain, seeds: int = 1) -> list[Cell]:
    return [cell_of(chain, SCENE, Work(Turned(), chain.presets["smoke"], seed)) for seed in range(seeds)]


@pytest.mark.parametrize(
    ("what", "told"),
    [
        (
            {"step": fails(ZeroDivisionError, "division by zero")},
            "step() of stage 'fine', iteration 0: ZeroDivisionError",
        ),
        ({"step": fails(SystemExit, 0)}, "step() of stage 'fine', iteration 0: SystemExit: 0"),
        ({"step": fails(torch.cuda.OutOfMemoryError, "too much")}, "OutOfMemoryError: too much"),
        ({"product": fails(KeyError, "value")}, "product() of stage 'fine': KeyError: 'value'"),
        ({"facts": fails(OSError, 28, "No space left")}, "facts(): OSError"),
        ({"prepare": fails(RuntimeError, "shapes\ndiffer")}, "prepare(): RuntimeError: shapes"),
    ],
)
def test_an_exception_in_a_method_fails_its_cell_with_its_name_and_traceback(
    what: Mapping[str, Callable[..., Any]], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store, wrong, right = Store(tmp_path), Wrong(**what), Chain(("fit",), name="right")
    failures = run_all(store, wrong, right, seeds=2)
    assert all(store.result(cell.key) for cell in cells_of(right, 2)), "other cells go on"
    assert len(failures) == 2
    for failure, cell in zip(failures, cells_of(wrong, 2), strict=True):
        assert failure.what.startswith("wrong failed in ")
        assert told in failure.what
        assert "test_wrong_methods.py" in failure.why
        assert "raise_it" in failure.why
        assert "stages.py" not in failure.why, "the harness is not where to look"
        kept = store.failure(cell.key)
        assert (kept["what"], kept["why"], kept["remedy"]) == (failure.what, failure.why, failure.remedy)
        assert kept["exit_code"] == 1
    (file,) = (tmp_path / "tracebacks").iterdir()
    assert file.read_text().startswith("Traceback (most recent call last):")
    assert str(file) in failures[0].remedy
    assert explained_code(failures, complain) == 1
    assert capsys.readouterr().err.count("error: ") == 1, "what failed alike is explained once"


def observed(run: Run) -> dict[str, Any]:
    """The surroundings of a row as its method finds them: the process's state, and sums over the scene's tensors."""
    scene = run.scene
    cameras = [view.camera.centre for view in (*scene.train, *scene.test, *scene.relight)]
    return {
        "folder": os.getcwd(),
        "variable": os.environ.get("ODD", ""),
        "modules": sys.path[0],
        "type": str(torch.zeros(1).dtype),
        "threads": torch.get_num_threads(),
        "deterministic": torch.are_deterministic_algorithms_enabled(),
        "gradients": torch.is_grad_enabled(),
        "precision": torch.get_float32_matmul_precision(),
        "denormal": float(torch.full((1,), 1e-40, dtype=torch.float32) * 1.0),
        "torch": float(torch.rand(1, dtype=torch.float64)),
        "numpy": float(np.random.rand()),  # noqa: NPY002  a method may
        "printing": np.get_printoptions()["precision"],
        "division": np.geterr()["divide"],
        "filters": len(warnings.filters),
        "interrupt": str(signal.getsignal(signal.SIGINT)),
        "stderr": str(sys.stderr),
        "cameras": float(torch.stack(cameras).sum()),
        "images": float(sum(view.read("image").sum() for view in scene.train)),
        "lights": float(sum(light.radiance.sum() for light in scene.lights.values())),
    }


class Observing(Chain):
    """A chain whose facts are what it observed in its first stage and when it was restored."""

    seen: Mapping[str, Any]

    def restore(self, run: Run, tensors: Mapping[str, Any]) -> ChainTrained:
        model = super().restore(run, tensors)
        before, after = self.seen, observed(run)
        model.facts = lambda: {"begun": dict(before), "restored": after}  # type: ignore[method-assign]
        return model

    def stages(self, variant: Turned, budget: Any) -> Any:
        specs = super().stages(variant, budget)
        begin = specs[0].begin

        def begin_observing(run: Run, before: Mapping[str, Any]) -> Any:
            self.seen = observed(run)
            return begin(run, before)

        object.__setattr__(specs[0], "begin", begin_observing)
        return specs


def scale_everything(run: Run) -> None:
    """Write into every tensor of the scene that a method is handed."""
    for view in {id(view): view for view in (*run.scene.train, *run.scene.test)}.values():
        view.camera.camera_to_world[:3, 3].add_(1.0)
        view.read("image").mul_(0.5)
    for light in run.scene.lights.values():
        light.radiance.div_(2)


ODD: Mapping[str, Callable[[Run], object]] = {
    "the working folder": lambda run: os.chdir("/"),
    "environment variables": lambda run: os.environ.update(ODD="1"),
    "where modules are looked for": lambda run: sys.path.insert(0, "/odd"),
    "PyTorch's default type": lambda run: torch.set_default_dtype(torch.float64),
    "PyTorch's number of threads": lambda run: torch.set_num_threads(torch.get_num_threads() + 1),
    "PyTorch's deterministic algorithms": lambda run: torch.use_deterministic_algorithms(True),
    "whether PyTorch keeps gradients": lambda run: torch.set_grad_enabled(False),
    "PyTorch's precision and denormal numbers": lambda run: (
        torch.set_float32_matmul_precision("medium"),
        torch.set_flush_denormal(True),
    ),
    "PyTorch's random numbers": lambda run: torch.manual_seed(7),
    "NumPy's random numbers": lambda run: np.random.seed(7),  # noqa: NPY002
    "how NumPy prints": lambda run: np.set_printoptions(precision=2, legacy="1.13"),
    "NumPy's treatment of errors": lambda run: np.seterr(all="raise"),
    "filters of warnings": lambda run: warnings.simplefilter("ignore"),
    "handlers of signals": lambda run: signal.signal(signal.SIGINT, signal.SIG_IGN),
    "standard output and errors": lambda run: setattr(sys, "stderr", sys.__stderr__),
    "": scale_everything,
}
"""Changes that a method may make, by their names in messages; changes of its copy of the scene are not reported."""


def facts_beside(folder: Path, *others: Chain) -> Mapping[str, Any]:
    """The observations of a row, after those of other methods."""
    store, observing = Store(folder), Observing(("fit",), name="observing")
    assert run_all(store, *others, observing) == []
    stored = store.result(cells_of(observing)[0].key)
    return stored["facts"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ODD)
def test_a_method_changes_nothing_of_another_row(name: str, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    places: list[Run] = []

    class Odd(Chain):
        def restore(self, run: Run, tensors: Mapping[str, Any]) -> ChainTrained:
            ODD[name](run)
            return super().restore(run, tensors)

        def _beginning(self, number: int) -> Any:
            begin = super()._beginning(number)

            def odd(run: Run, before: Mapping[str, Any]) -> Any:
                places.append(run)
                ODD[name](run)
                return begin(run, before)

            return odd

    given = torch.cat([light.radiance.flatten() for light in SCENE.lights.values()])
    alone = facts_beside(tmp_path / "alone")
    with caplog.at_level("WARNING"):
        beside = facts_beside(tmp_path / "beside", Odd(("fit",), name=f"odd {name}"))
    assert places, "the other method was called"
    assert beside == alone
    assert torch.equal(given, torch.cat([light.radiance.flatten() for light in SCENE.lights.values()]))
    said = [line for line in caplog.messages if line.startswith(f"odd {name} changed")]
    assert len(said) == bool(name), "once, however often it is done"
    assert all(name in line for line in said)


def test_a_method_seeds_python_s_random_numbers_for_itself_alone() -> None:
    drawn = []
    for _ in range(2):
        begin_row()
        for _ in range(2):
            with calling("draws", "step()"):
                drawn.append(random.random())
    with calling("seeds", "step()"):
        random.seed(7)
    assert random.random() != random.Random(7).random()
    assert drawn[0] == drawn[2], "every row begins alike"
    assert drawn[0] != drawn[1] != drawn[2], "and draws on"


def test_a_method_finds_in_its_next_call_what_it_changed_and_in_its_next_row_nothing(tmp_path: Path) -> None:
    found: list[tuple[torch.dtype, float]] = []

    class Keeping(Chain):
        def restore(self, run: Run, tensors: Mapping[str, Any]) -> ChainTrained:
            found.append((torch.get_default_dtype(), float(torch.rand(1, dtype=torch.float64))))
            return super().restore(run, tensors)

        def _beginning(self, number: int) -> Any:
            begin = super()._beginning(number)

            def keep(run: Run, before: Mapping[str, Any]) -> Any:
                found.append((torch.get_default_dtype(), float(torch.rand(1, dtype=torch.float64))))
                torch.set_default_dtype(torch.float64)
                return begin(run, before)

            return keep

    assert run_all(Store(tmp_path), Keeping(("fit",), name="keeping"), seeds=2) == []
    kinds, numbers = zip(*found, strict=True)
    assert kinds == (torch.float32, torch.float64) * 2
    assert numbers[0] != numbers[1], "numbers are drawn on, not drawn again"
    assert numbers[:2] == numbers[2:], "the next row begins as the first did"
    assert torch.get_default_dtype() == torch.float32


def test_a_method_reads_its_scene_from_wherever_it_goes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A relative path of a scene is from where the run was started."""
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "image.txt").write_text("0.5")
    monkeypatch.chdir(tmp_path / "here")

    def image() -> torch.Tensor:
        return torch.full((16, 16, 3), float(Path("image.txt").read_text()))

    view = replace(SCENE.train[0], sources={"image": image})
    with calling("goes", "step()"):
        os.chdir("/")
        assert float(own_scene(replace(SCENE, train=(view,))).train[0].read("image").mean()) == 0.5
        assert os.getcwd() == "/"
    assert Path.cwd() == tmp_path / "here"


class Nameless(Exception):
    def __str__(self) -> str:
        raise ValueError("no text")


@pytest.mark.slow
@pytest.mark.parametrize(
    "error", [asyncio.CancelledError, KeyboardInterrupt, GeneratorExit, BaseException, SystemExit, Nameless]
)
@pytest.mark.parametrize("where", ["step", "product", "facts", "prepare"])
def test_whatever_a_method_raises_ends_its_cell_alone_and_is_recorded(
    error: type[BaseException], where: str, tmp_path: Path
) -> None:
    store, wrong, right = Store(tmp_path), Wrong(**{where: fails(error)}), Chain(("fit",), name="right")
    with Interruption():
        (failure,) = run_all(store, wrong, right)
    assert store.result(cells_of(right)[0].key) is not None
    kept = store.failure(cells_of(wrong)[0].key)
    assert kept["what"] == failure.what
    assert error.__name__ in failure.what


def test_a_second_ctrl_c_stops_a_run_within_a_method(tmp_path: Path) -> None:
    def pressed_twice(*given: Any) -> Any:
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt), Interruption():
        run_all(Store(tmp_path), Wrong(step=pressed_twice))


def cyclic() -> dict[str, Any]:
    values: list[Any] = []
    values.append(values)
    return {"value": values}


def nested(depth: int) -> dict[str, Any]:
    values: Any = 0.0
    for _ in range(depth):
        values = [values]
    return {"value": values}


def showing(name: str, image: Callable[[], Any]) -> Callable[..., Any]:
    """A model that renders one more map, or another one."""

    def prepare(*given: Any) -> Any:
        shown = ChainPrepared(0.5)
        shown.offers = {**ChainPrepared.offers, name: MapKind("data")}
        maps = shown.render
        shown.render = lambda camera, *further: {**maps(camera), name: image()}  # type: ignore[method-assign]
        return shown

    return prepare


def offering_nothing(*given: Any) -> Any:
    shown = ChainPrepared(0.5)
    shown.offers = None  # type: ignore[assignment]
    return shown


@pytest.mark.parametrize(
    ("what", "code"),
    [
        ({"step": lambda: {"loss": 10**400}}, 1),
        ({"product": cyclic}, 1),
        ({"facts": lambda: nested(5000)}, 1),
        ({"product": lambda: {"value": torch.zeros(1, device="meta")}}, 1),
        ({"prepare": offering_nothing}, 6),
        ({"prepare": showing("image", lambda: torch.zeros(16, 16, 3, device="meta"))}, 1),
        ({"prepare": showing("image", lambda: torch.zeros(16, 16, 3).to_sparse())}, 1),
        ({"prepare": showing("roughness", lambda: torch.full((16, 16, 1), torch.nan))}, 4),
    ],
)
def test_whatever_a_method_gives_ends_its_cell_alone_and_is_recorded(
    what: Mapping[str, Callable[..., Any]], code: int, tmp_path: Path
) -> None:
    store, wrong, right = Store(tmp_path), Wrong(**what), Chain(("fit",), name="right")
    (failure,) = run_all(store, wrong, right)
    assert exit_code(failure) == code
    assert store.result(cells_of(right)[0].key) is not None
    kept = store.failure(cells_of(wrong)[0].key)
    assert kept["exit_code"] == code


CALLS = ("begin", "step", "state", "product", "restore", "facts", "prepare", "offers", "render")
"""The calls of the contract that a cell makes, and a property."""

OUTCOMES: Mapping[str, Callable[[], Any]] = {
    "an exception": fails(ValueError, "no"),
    "a BaseException": fails(BaseException, "no"),
    "a cancellation": fails(asyncio.CancelledError),
    "an exit": fails(SystemExit, 3),
    "nothing": lambda: None,
    "a number": lambda: 7,
    "a number beyond float64": lambda: {"value": 10**400, "image": 10**400},
    "text": lambda: "\x1b[2J",
    "text that UTF-8 cannot hold": lambda: {"value": "\ud800", "image": "\ud800", "\ud800": 1},
    "an empty table": dict,
    "a cycle": cyclic,
    "a deep list": lambda: nested(5000),
    "NaN": lambda: {"value": torch.tensor([math.nan]), "image": torch.full((16, 16, 3), math.nan)},
    "tensors without values": lambda: {name: torch.zeros(16, 16, 3, device="meta") for name in ("value", "image")},
    "sparse tensors": lambda: {name: torch.zeros(16, 16, 3).to_sparse() for name in ("value", "image")},
    "tensors of 16 bits": lambda: {name: torch.zeros(16, 16, 3, dtype=torch.bfloat16) for name in ("value", "image")},
    "a default type": lambda: torch.set_default_dtype(torch.float64),
    "a folder": lambda: os.chdir("/"),
}  # fmt: skip


class WrongIn(Chain):
    """A chain in which one call, given by name, has another outcome."""

    def __init__(self, call: str, outcome: str) -> None:
        super().__init__(("fit",), name=f"{CALLS.index(call)}-{list(OUTCOMES).index(outcome)}")
        self.call, self.outcome = call, OUTCOMES[outcome]

    def instead(self, call: str, right: Any) -> Any:
        return (lambda *given: self.outcome()) if call == self.call else right

    def _beginning(self, number: int) -> Any:
        def begin(run: Run, before: Mapping[str, Any]) -> Any:
            stage = super(WrongIn, self)._beginning(number)(run, before)
            for name in ("step", "state", "product"):
                setattr(stage, name, self.instead(name, getattr(stage, name)))
            return stage

        return self.instead("begin", begin)

    def restore(self, run: Run, tensors: Mapping[str, Any]) -> Any:
        model = self.instead("restore", super().restore)(run, tensors)
        if self.call in ("facts", "prepare"):
            setattr(model, self.call, self.instead(self.call, None))
        elif self.call in ("offers", "render"):
            prepare = model.prepare

            def shown(*given: Any) -> Any:
                prepared = prepare(*given)
                setattr(prepared, self.call, self.outcome() if self.call == "offers" else self.instead("render", None))
                return prepared

            model.prepare = shown
        return model


def values(store: Store, chain: Chain) -> Any:
    result = store.result(cells_of(chain)[0].key)
    with np.load(store.arrays_path(result["key"])) as arrays:
        return result["metrics"], result["losses"], {name: arrays[name].tobytes() for name in arrays}


@pytest.mark.slow
@pytest.mark.parametrize("call", CALLS)
def test_every_call_with_every_wrong_outcome_leaves_other_rows_as_they_are(call: str, tmp_path: Path) -> None:
    """A cell whose call has a wrong outcome ends with a result or a record of its failure."""
    right = Chain(("fit", "finish"), name="right")
    assert run_all(Store(tmp_path / "alone"), right) == []
    alone = values(Store(tmp_path / "alone"), right)
    store, wrong = Store(tmp_path / "beside"), [WrongIn(call, outcome) for outcome in OUTCOMES]
    with Interruption():
        run_all(store, *wrong, right, checkpoint_seconds=0.0)
    assert values(store, right) == alone
    keys = [cells_of(each)[0].key for each in wrong]
    failed = [store.failure(key) is not None for key in keys]
    assert failed == [store.result(key) is None for key in keys]
    assert sum(failed) >= len(OUTCOMES) // 2


def test_values_of_16_bits_are_scored_and_buffers_that_are_used_again_are_copied() -> None:
    buffer = torch.zeros(16, 16, 1)
    shown = showing("depth", lambda: buffer.add_(1))()
    first, second = (on_black(shown, CAMERA)["depth"] for _ in range(2))
    assert (float(first.mean()), float(second.mean())) == (1.0, 2.0)
    half = on_black(showing("image", lambda: torch.full((16, 16, 3), 0.5, dtype=torch.bfloat16))(), CAMERA)["image"]
    assert half.dtype == torch.float32


def test_an_error_s_text_cannot_command_the_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run_all(Store(tmp_path), failures := Wrong(step=fails(ValueError, "\x1b[2J\x1b]0;title\x07")))
    assert failures.begun
    (failure,) = run_all(Store(tmp_path), failures)
    explained_code([failure], complain)
    said = capsys.readouterr().err
    assert "title" in said
    assert "\x1b" not in said


@pytest.mark.parametrize("error", [NotOffered("not this"), UsageError("a", "b"), NumericalFailure("c")])
def test_explained_errors_of_a_method_pass_unchanged(error: ExplainedError) -> None:
    with pytest.raises(type(error)) as raised, calling("x", "step()"):
        raise error
    assert raised.value is error


def test_ctrl_c_is_no_failure_of_a_method() -> None:
    with pytest.raises(KeyboardInterrupt), calling("x", "step()"):
        raise KeyboardInterrupt


def test_a_failure_keeps_its_traceback_between_processes() -> None:
    with pytest.raises(MethodFailed) as raised, calling("x", "step()"):
        fails(ValueError, "y")()
    there = pickle.loads(pickle.dumps(raised.value))
    assert (there.what, there.why, there.trace) == (raised.value.what, raised.value.why, raised.value.trace)
    assert "ValueError: y" in there.trace
    assert explain(there).startswith("error: x failed in step(): ValueError: y\n  File")


def test_a_method_that_fails_where_kernels_are_compiled_does_not_end_the_run() -> None:
    broken, right = Chain(("fit",), (True,), broken="fit"), Chain(("fit",), (True,), name="right")
    compile_kernels(SCENE, CPU, [(broken, Turned()), (right, Turned())])
    assert right.stepped == ["fit"]


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_loss_that_is_not_finite_ends_the_cell_and_its_state_is_kept(value: float, tmp_path: Path) -> None:
    store, right = Store(tmp_path), Chain(("fit",), name="right")
    (failure,) = run_all(store, Wrong(step=lambda: {"fit": 1.0, "prior": value}), right)
    assert isinstance(failure, NumericalFailure)
    assert failure.what == f"wrong: loss 'prior' is {value} in stage 'fine' at iteration 0"
    (kept,) = tmp_path.rglob("*.broken.pt")
    assert str(kept) in failure.remedy
    assert store.result(cells_of(right)[0].key) is not None


def test_losses_are_numbers_and_tensors_of_one_element_count_as_such() -> None:
    given = {"a": torch.tensor(0.5, requires_grad=True), "b": np.float32(2), "c": 1, "d": torch.ones(1, 1)}
    found = losses_of("x", given, "fit")
    assert found == {"a": 0.5, "b": 2.0, "c": 1.0, "d": 1.0}
    assert {type(value) for value in found.values()} == {float}
    assert losses_of("x", {}, "fit") == {}
    with pytest.raises(MethodFailed, match="x: step\\(\\) of stage 'fit' returned a NoneType"):
        losses_of("x", None, "fit")
    with pytest.raises(MethodFailed, match="x: loss 'a' of stage 'fit' is a Tensor"):
        losses_of("x", {"a": torch.ones(2)}, "fit")


KEPT = {
    "tensors": [torch.ones(2), torch.nn.Parameter(torch.ones(2))],
    "plain": (None, True, 1, 1.5, 1j, "a", b"b", bytearray(b"c")),
    "torch": [torch.Size([1]), torch.float32, CPU],
    "groups": {"set": {1}, "ordered": OrderedDict(a=1), "counter": Counter("a"), 3: "number as key", (1, 2): "pair"},
}


def test_every_storable_value_can_be_read_again(tmp_path: Path) -> None:
    require_storable("x", KEPT, "state()", "fit")
    store = Store(tmp_path)
    store.put_tensors("stages/x", KEPT)
    assert store.tensors("stages/x", CPU) is not None
    assert not (tmp_path / "aside").exists()


@pytest.mark.parametrize(
    ("value", "kind"),
    [
        (np.zeros(2), "numpy.ndarray"),
        (np.float64(1), "numpy.float64"),
        (Path("a"), "PosixPath"),
        (frozenset([1]), "builtins.frozenset"),
        (torch.optim.SGD([torch.zeros(1)]), "torch.optim.sgd.SGD"),
    ],
)
def test_values_that_could_not_be_read_again_are_refused_by_name(value: object, kind: str, tmp_path: Path) -> None:
    with pytest.raises(MethodFailed, match=rf"x: state\(\)\['a'\]\[1\] of stage 'fit' is a .*{kind}"):
        require_storable("x", {"a": (1, value)}, "state()", "fit")
    store = Store(tmp_path)
    store.put_tensors("stages/x", {"a": value})
    assert store.tensors("stages/x", CPU) is None, "what is refused is what PyTorch does not read"


def test_a_product_that_could_not_be_read_again_is_not_kept(tmp_path: Path) -> None:
    (failure,) = run_all(Store(tmp_path), Wrong(product=lambda: {"value": np.zeros(1)}))
    assert failure.what == "wrong: product()['value'] of stage 'fine' is a numpy.ndarray"


def test_facts_are_plain() -> None:
    model = ChainTrained(torch.ones(1), 1.0)
    assert facts_of("x", model) == {"value": 1.0}
    for number in ("a tensor", "not finite"):
        value = torch.ones(1) if number == "a tensor" else math.nan
        model.facts = lambda value=value: {"value": value}  # type: ignore[method-assign, misc]
        with pytest.raises(MethodFailed, match="x: facts\\(\\) cannot be kept"):
            facts_of("x", model)


def test_attributes_that_are_missing_are_named() -> None:
    assert members(Stage) == ("iteration", "iterations", "step", "state", "restore", "product")
    assert members(Prepared) == ("offers", "default", "timed", "render")
    for kind, contract in ((Chain, Method), (ChainTrained, Trained), (ChainPrepared, Prepared)):
        assert [name for name in lacking(kind, contract) if name != "name"] == []
    assert lacking(ChainStage, Stage) == ["iteration", "iterations"], "those are set in __init__"
    with pytest.raises(MethodFailed, match="x: what prepare\\(\\) gave lacks offers, default, timed, render"):
        require("x", None, Prepared, "prepare()")


CAMERA = SCENE.test[0].camera


@pytest.mark.parametrize(
    ("name", "image", "what", "why"),
    [
        ("image", np.zeros((16, 16, 3)), "'image' of ndarray", "tensors of floating point"),
        ("image", torch.zeros(16, 16, 3, dtype=torch.uint8), "'image' of torch.uint8", "tensors of floating point"),
        ("image", torch.zeros(3, 16, 16), "'image' of shape (3, 16, 16)", "(16, 16, 3): height, width, channels"),
        ("alpha", torch.zeros(16, 16), "'alpha' of shape (16, 16)", "(16, 16, 1)"),
        ("gloss", torch.zeros(16, 16, 1), "'gloss' that it does not offer", "names: image, alpha"),
        (
            "image",
            torch.full((16, 16, 3), torch.nan),
            "'image' that is not finite, of view 'v'",
            "768 of its 768 values",
        ),
    ],
)
def test_a_map_that_cannot_be_scored_is_refused_with_its_fault(
    name: str, image: Any, what: str, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = ChainPrepared(0.5)
    monkeypatch.setattr(shown, "render", lambda camera, *further: {name: image})
    with pytest.raises((MethodFailed, NumericalFailure)) as refused:
        on_black(shown, CAMERA, method="mine", view="v")
    assert refused.value.what.startswith("mine")
    assert what in refused.value.what
    assert why in refused.value.why


def test_a_map_with_a_gradient_is_scored(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = ChainPrepared(0.5)
    monkeypatch.setattr(shown, "render", lambda *given: {"image": torch.full((16, 16, 3), 0.5, requires_grad=True)})
    assert not on_black(shown, CAMERA)["image"].requires_grad


def test_a_package_that_is_broken_does_not_hide_the_others(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "broken_method.py").write_text("x = 1\n1 / 0\n")
    monkeypatch.syspath_prepend(tmp_path)
    broken = EntryPoint("broken", "broken_method:METHOD", installed_methods.GROUP)
    offered = {**installed_methods.offered_methods(), "broken": broken}
    for module in (methods, installed_methods):
        monkeypatch.setattr(module, "offered_methods", lambda: offered)
    assert main(["methods"]) == 0
    assert "broken" in capsys.readouterr().out
    assert main(["methods", "--json"]) == 2
    said = capsys.readouterr()
    assert "radiogs" in said.out
    assert "the method 'broken' cannot be loaded" in said.err
    assert f"ZeroDivisionError: division by zero, at {tmp_path / 'broken_method.py'}, line 2" in said.err
    assert main(["methods", "broken"]) == 2
    assert main(["methods", "radiogs"]) == 0


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("del Mine.title", "it lacks title"),
        ("METHOD = Mine", "it is the class Mine and has to be an instance of it"),
        ("METHOD.name = 'theirs'", "its name is 'theirs' and the key of its entry point 'mine'"),
        ("METHOD.variant = Variant()", "its variant has to be a dataclass, the class itself"),
        ("METHOD.variant = Budget", "its variant has no default for name"),
        ("METHOD.presets = {'tiny': Budget('tiny')}", "its presets are tiny, and 'smoke' has to be among them"),
        ("METHOD.presets = {'smoke': Budget('small')}", "its preset 'smoke' has to be an instance of a dataclass"),
        ("METHOD.presets = {'smoke': {'name': 'smoke'}}", "its preset 'smoke' has to be an instance of a dataclass"),
    ],
)
def test_every_fault_of_a_method_is_explained(
    change: str, told: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    text = """
from dataclasses import dataclass

@dataclass(frozen=True)
class Variant:
    weight: float = 1.0

@dataclass(frozen=True)
class Budget:
    name: str

class Mine:
    name, title, variant, presets, sources = "mine", "Mine", Variant, {"smoke": Budget("smoke")}, ("mine",)
    def stages(self, variant, budget): return ()
    def restore(self, run, tensors): return None

METHOD = Mine()
"""
    module = f"mine_{abs(hash(change))}"
    (tmp_path / f"{module}.py").write_text(f"{text}{change}\n")
    monkeypatch.syspath_prepend(tmp_path)
    offered = {"mine": EntryPoint("mine", f"{module}:METHOD", installed_methods.GROUP)}
    monkeypatch.setattr(methods, "offered_methods", lambda: offered)
    with pytest.raises(UsageError, match="the method 'mine' is not what a method is") as refused:
        methods.method("mine")
    assert told in refused.value.why
