"""Counts go to the innermost recording, and are dropped outside all recordings."""

import ast
import threading
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

import radiogs
import radiogs_core
from elsewhere import elsewhere, registered
from radiogs_core.instruments import Instruments, Tally, count, current, fire, part, recording


def test_an_outer_recording_stands_still_while_an_inner_one_receives() -> None:
    with recording() as outer:
        count(rays=1)
        with recording() as inner:
            count(rays=10)
            fire(full_rays=2)
        count(rays=100)
    assert outer.work == {"rays": 101}
    assert not outer.guards
    assert inner.work == {"rays": 10}
    assert inner.guards == {"full_rays": 2}


def test_outside_of_all_recordings_nothing_is_kept() -> None:
    count(rays=1)
    fire(full_rays=1)
    with part("probe"):
        pass
    assert current() is None
    with recording() as instruments:
        pass
    assert instruments == Instruments()


def test_a_recording_ends_with_the_exception_that_ended_it() -> None:
    instruments = Instruments()

    def broken() -> None:
        with recording(instruments):
            count(rays=1)
            raise ValueError("over")

    with pytest.raises(ValueError, match="over"):
        broken()
    assert instruments.work == {"rays": 1}
    assert current() is None


def test_a_stored_recording_is_continued() -> None:
    with recording() as whole:
        count(rays=1)
        with part("probe"):
            count(rays=2)
        fire(full_rays=3)
    resumed = Instruments()
    resumed.restore(whole.plain())
    assert resumed == whole
    for instruments in (whole, resumed):
        with recording(instruments):
            count(rays=4, hits=5)
    assert resumed == whole
    assert resumed.work == {"rays": 7, "hits": 5, "probe_rays": 2}


def test_a_part_has_its_own_seconds_and_rays() -> None:
    with recording() as instruments:
        count(rays=1)
        for rays in (2, 3):
            with part("probe"):
                count(rays=rays)
    assert instruments.work == {"rays": 6, "probe_rays": 5}
    assert instruments.parts.keys() == {"probe"}
    assert instruments.parts["probe"] > 0


class Counting(torch.autograd.Function):
    """Counts in both passes, as a Function must that wants its backward pass counted on CUDA."""

    @staticmethod
    def forward(ctx: Any, value: Tensor) -> Tensor:
        count(rays=1)
        ctx.instruments = current()
        return value.clone()

    @staticmethod
    def backward(ctx: Any, upstream: Tensor) -> Any:
        with recording(ctx.instruments):
            count(rays=10)
        return upstream


def test_a_backward_pass_in_another_thread_counts_where_its_forward_pass_did() -> None:
    with recording() as instruments:
        total = Counting.apply(torch.ones(3, requires_grad=True)).sum()
        thread = threading.Thread(target=total.backward)
        thread.start()
        thread.join()
    assert instruments.work == {"rays": 11}


def test_no_backward_pass_counts_into_the_recording_of_its_own_thread() -> None:
    """``Function.backward`` runs in a thread without a recording: it counts within ``recording(ctx....)`` or not."""
    for package in (radiogs_core, radiogs):
        assert package.__file__ is not None
        for file in Path(package.__file__).parent.rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text())):
                if isinstance(node, ast.FunctionDef) and node.name == "backward" and node.args.args[0].arg == "ctx":
                    inner = ast.unparse(node)
                    assert "recording(ctx." in inner or not {"count(", "fire("} & {
                        f"{ast.unparse(call.func)}(" for call in ast.walk(node) if isinstance(call, ast.Call)
                    }, file


def test_counts_of_host_and_device_add_up_and_are_awaited_once() -> None:
    there, tally = registered(), Tally({"rays": 1})
    with elsewhere() as account:
        for amount in (2, 3):
            tally.add({"rays": 10 * amount, "hits": torch.tensor(amount, device=there)})
        tally.add({"lobes": torch.tensor(7, device=there)})
        before = account.waits
        found = dict(tally.read())
        assert account.waits <= before + 1
    assert found == {"rays": 51, "hits": 5, "lobes": 7}
