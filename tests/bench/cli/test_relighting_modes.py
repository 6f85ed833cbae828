"""A method names its ways of relighting: the command takes them, and a run records them for the figures."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from bench.chain_method import Chain
from bench.fake_method import FAKE
from radiogs.method import RADIOGS
from radiogs.settings import RELIGHTING
from radiogs_bench.cli.relight import ONLY_MODE, chosen_mode
from radiogs_bench.installed_methods import substitutes
from radiogs_bench.runs.sweep import read_sweep
from radiogs_core.capabilities import RelightingModes, RelitInModes
from radiogs_core.errors import UsageError
from radiogs_core.plain_values import leaf_names
from radiogs_reports.summary import read_summary

FakeRun = Callable[..., int]


class TwoWays(Chain):
    """A method that relights in two ways, by a field of its variant."""

    relighting_modes = RelightingModes("shown", {"bright": "bright maps", "dim": "dim maps"}, "bright")


def test_the_modes_of_radiogs_are_values_of_fields_that_exist() -> None:
    assert isinstance(RADIOGS, RelitInModes)
    variant, budget = RADIOGS.variant(), RADIOGS.presets["smoke"]
    assert RELIGHTING.field in leaf_names(variant)
    assert RELIGHTING.steps in leaf_names(budget)
    assert getattr(variant, RELIGHTING.field) == RELIGHTING.default
    assert {*RELIGHTING.by_steps, RELIGHTING.default, RELIGHTING.reference} <= RELIGHTING.titles.keys()
    for mode in RELIGHTING.titles:
        assert RADIOGS.stages(replace(variant, **{RELIGHTING.field: mode}), budget)[-1].reads == (
            RADIOGS.stages(variant, budget)[-1].reads
        ), "training does not read the mode"


def test_the_command_takes_the_modes_of_the_method(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(substitutes, "chain", TwoWays(("fit",)))
    assert chosen_mode("chain", None, {}) == ("bright", {"shown": "bright"})
    assert chosen_mode("chain", None, {"shown": "dim"}) == ("dim", {"shown": "dim"}), "that of the model's settings"
    assert chosen_mode("chain", "dim", {"shown": "bright"}) == ("dim", {"shown": "dim"})
    with pytest.raises(UsageError, match=r"unknown relighting mode 'brihgt' of chain\nDid you mean 'bright'"):
        chosen_mode("chain", "brihgt", {})


def test_a_method_without_modes_takes_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(substitutes, "chain", Chain(("fit",)))
    assert chosen_mode("chain", None, {}) == (ONLY_MODE, {})
    with pytest.raises(UsageError, match="chain relights in one way alone"):
        chosen_mode("chain", "bright", {})


def test_a_run_records_the_modes_and_its_summary_has_them(
    fake_run: FakeRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(type(FAKE), "relighting_modes", RELIGHTING, raising=False)
    assert fake_run("ablations") == 0
    assert read_sweep(tmp_path)["relighting"] == {"radiogs": RELIGHTING.plain()}
    assert read_summary(tmp_path)["relighting"] == {"radiogs": RELIGHTING.plain()}
