"""A method that does something wrong ends its own cell, and whoever wrote it is told what and where."""

import math
import pickle
from collections import Counter, OrderedDict
from collections.abc import Callable, Mapping
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from bench.chain_method import Chain, ChainPrepared, ChainStage, ChainTrained, Turned
from radiogs_bench import installed_methods, methods
from radiogs_bench.cli import main
from radiogs_bench.cli.run import report_failures
from radiogs_bench.errors import MethodFailed, explain
from radiogs_bench.method_calls import calling, lacking, losses_of, members, require, require_storable
from radiogs_bench.runs.cell import Cell, Work, cell_of
from radiogs_bench.runs.engines.in_process import Task, run_cells
from radiogs_bench.runs.interruption import Interruption
from radiogs_bench.runs.preflight import compile_kernels
from radiogs_bench.runs.progress import LogProgress
from radiogs_bench.runs.scene_digest import checksum_now
from radiogs_bench.runs.stages import Bench, facts_of
from radiogs_bench.runs.train import train_and_score
from radiogs_bench.scoring.maps import on_black
from radiogs_bench.store.folder import Store
from radiogs_core.contract import Method, NotOffered, Prepared, Stage, Trained
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


def run_all(store: Store, *chains: Chain, seeds: int = 1) -> list[ExplainedError]:
    """Run the cells of some methods; returns why some failed."""
    found = {chain.name: chain for chain in chains}
    bench = Bench(store, CPU, LogProgress(), Interruption(), found.__getitem__, checksum_now)
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
        assert kept is not None
        assert (kept["what"], kept["why"], kept["remedy"]) == (failure.what, failure.why, failure.remedy)
        assert kept["exit_code"] == 1
    (file,) = (tmp_path / "tracebacks").iterdir()
    assert file.read_text().startswith("Traceback (most recent call last):")
    assert str(file) in failures[0].remedy
    assert report_failures(failures) == 1
    assert capsys.readouterr().err.count("error: ") == 1, "what failed alike is explained once"


def test_a_repaired_method_runs_and_its_failure_is_removed(tmp_path: Path) -> None:
    store, wrong = Store(tmp_path), Wrong(step=fails(ValueError, "x"))
    assert len(run_all(store, wrong)) == 1
    wrong.what = {}
    assert run_all(store, wrong) == []
    (cell,) = cells_of(wrong)
    assert store.failure(cell.key) is None
    assert wrong.begun.count("coarse") == 1, "the stage before it was kept"


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
def test_a_map_that_cannot_be_scored_is_refused_with_what_is_wrong(
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
