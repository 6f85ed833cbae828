"""Missing cells are forecast from finished cells like them; without any, the forecast is unknown."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bench.fake_method import CPU, SCENE, FakeSweep, asked, fake_cell
from radiogs.settings import PRESETS, Variant
from radiogs_bench.cli.plan import needs, show_plan, whole_memory, whole_time
from radiogs_bench.runs.forecast import Expected, forecast, total
from radiogs_bench.store.folder import Store, product_name
from radiogs_bench.store.seal import sealed, strict_json
from radiogs_core.kernels.runtime import workers
from radiogs_reports.analysis.power import Planned
from radiogs_reports.statistics import Level

CELLS = [cell for _, cell in asked(2).cells]
SECONDS = {"initialise": 100.0, "invert": 10.0, "evaluate": 1.0}


def measured(store: Store, key: str, seconds: dict[str, float], held: dict[str, int]) -> None:
    """Write other figures of cost into a stored result, whose arrays stay."""
    result: Any = store.result(key)
    result["seconds"] = seconds
    for sessions in result["sessions"].values():
        for session in sessions:
            session["peak_memory_bytes"] = held
    store.take_over({f"cells/{key}.json": strict_json(sealed(result))})


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """Holds the whole first seed; rows took SECONDS, but the last one ten times as long."""
    sweep = FakeSweep(tmp_path)
    sweep.run(CELLS[:5])
    for cell in CELLS[:4]:
        measured(sweep.store, cell.key, SECONDS, {"host": 2**30})
    slow = {stage: 10 * seconds for stage, seconds in SECONDS.items()}
    measured(sweep.store, CELLS[4].key, slow, {"host": 2**31, "device": 2**29})
    return sweep.store


def test_a_rows_forecast_is_its_own_time_and_shared_stages_count_once(store: Store) -> None:
    expected = forecast(store, CELLS)
    assert expected[:5] == [None] * 5
    assert expected[5:] == [
        Expected(111.0, 2**30, None),
        *[Expected(11.0, 2**30, None)] * 3,  # stage 1 comes with the first
        Expected(1110.0, 2**31, 2**29),
    ]
    assert total(expected) == (pytest.approx(111 + 3 * 11 + 1110), 0)
    assert whole_time(expected) == "about 20.9 min"
    assert whole_memory(expected) == "up to 2.00 GiB, GPU 0.50 GiB"


def test_several_at_a_time_share_the_work_until_the_longest_cell_decides() -> None:
    cells = [None, *[Expected(100.0, None, None)] * 6]
    assert whole_time(cells) == "about 10.0 min"
    assert whole_time(cells, 2) == "about 5.0 min"
    assert whole_time([*cells, Expected(1000.0, None, None)], 4) == "about 16.7 min"


def test_a_plan_says_what_workers_take_and_on_how_many_threads_that_was_measured(
    store: Store, capsys: pytest.CaptureFixture[str]
) -> None:
    request = asked(3)
    measured_on = workers(CPU)
    show_plan(request, store, 2, measured_on + 1, {})
    said = capsys.readouterr().out
    assert "10 of 15 cells to run" in said
    note = f"measured on {measured_on} threads a cell; here a cell has {measured_on + 1}"
    assert f"time, one after the other: about 41.8 min ({note})" in said  # twice 111 + 3 * 11 + 1110 seconds
    assert "time, 2 at a time: about 20.9 min\n" in said
    show_plan(request, store, 1, measured_on, {})
    said = capsys.readouterr().out
    assert "about 41.8 min\n" in said
    assert "at a time" not in said


def test_stored_stages_take_no_time_in_a_forecast(store: Store) -> None:
    for stage in CELLS[5].stages:
        store.put_tensors(product_name(stage.key), {})
    assert forecast(store, CELLS[5:6]) == [Expected(1.0, 2**30, None)]


def test_a_row_that_never_ran_is_forecast_from_other_rows(store: Store) -> None:
    new = fake_cell(seed=7, variant=Variant(radiometric_weight=0.5))
    (expected,) = forecast(store, [new])
    assert expected.seconds == pytest.approx((4 * 111 + 1110) / 5)


def test_another_scene_is_forecast_from_this_one(store: Store) -> None:
    assert forecast(store, [fake_cell(seed=7, scene=replace(SCENE, checksum="1" * 64))]) == [
        Expected(111.0, 2**30, None)
    ]


@pytest.mark.parametrize("change", [{"budget": PRESETS["tiny"]}, {"device": "cuda"}, {"experiment": "forward-parity"}])
def test_a_forecast_of_unlike_work_is_unknown(change: dict[str, Any], store: Store) -> None:
    expected = forecast(store, [fake_cell(**change)])
    assert expected == [Expected(None, None, None)]
    assert total(expected) == (0.0, 1)
    assert whole_time(expected).startswith("unknown")
    assert whole_memory(expected) == "unknown"


@pytest.mark.parametrize(
    ("needed", "said"),
    [
        (
            {"scenes": 9, "seeds": 4},
            "9 scenes of each kind, with as many seeds as now, or 4 seeds on as many scenes as now.",
        ),
        ({"kinds": 7}, "7 kinds of scenes, each with as many scenes and seeds as now."),
        ({}, "neither scenes nor seeds that the stored spread tells of."),
    ],
)
def test_the_scenes_and_seeds_that_a_difference_needs_are_printed(needed: dict[Level, int], said: str) -> None:
    column = {"key": "nvs/psnr", "label": "NVS PSNR", "unit": "dB", "direction": "up", "decimals": 2}
    found = needs(Planned(column, 0.4, 0.25, needed))  # type: ignore[arg-type]
    assert found == f"To resolve 0.25 dB of NVS PSNR in four of five runs: {said}"
