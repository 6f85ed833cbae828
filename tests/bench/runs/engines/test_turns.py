"""The order in which the workers of a pool take cells: comparisons are complete early, and all workers end together."""

import heapq
import random
from pathlib import Path

import pytest

from bench.fake_method import FakeSweep, asked, fake_cell, scene_of
from radiogs_bench.runs.cell import Cell
from radiogs_bench.runs.engines.in_process import waits_for_others
from radiogs_bench.runs.engines.run import in_turn
from radiogs_bench.store.folder import Store, product_name, stage_claim

STAGE_1, REST = 54.0, 36.0
"""Seconds of stage 1, and of stage 2 with the evaluation, of a cell of ``make ablations``."""


def cells_of(scenes: int) -> list[Cell]:
    """The ablations on so many scenes."""
    whole = asked(scenes={name: scene_of(name) for name in map(str, range(scenes))})
    return [cell for _, cell in in_turn(whole.cells, Store(Path("nowhere")), 2)]


def seconds_of(order: list[Cell], seed: int) -> tuple[float, float]:
    """When the last of two workers ends, which take the next cell that can be run, and half of all their seconds.

    Scenes differ by a fifth, cells by a twentieth.
    """
    drawn = random.Random(seed)
    factor = {scene: drawn.uniform(0.8, 1.2) for scene in sorted({cell.scene for cell in order})}
    length = {cell.key: REST * factor[cell.scene] * drawn.uniform(0.95, 1.05) for cell in order}
    ready: dict[str, float] = {}
    free, left, end, work = [0.0, 0.0], list(order), 0.0, 0.0
    while left:
        now = heapq.heappop(free)
        found = next((cell for cell in left if ready.get(cell.first_key, 0.0) <= now), None)
        if found is None:
            heapq.heappush(free, min(when for when in ready.values() if when > now))
            continue
        left.remove(found)
        taken = length[found.key]
        if found.first_key not in ready:
            taken += STAGE_1 * factor[found.scene]
            ready[found.first_key] = now + STAGE_1 * factor[found.scene]
        work += taken
        end = max(end, now + taken)
        heapq.heappush(free, now + taken)
    return end, work / 2


def test_two_workers_end_the_ablations_within_a_fiftieth_of_what_is_possible() -> None:
    order = cells_of(8)
    for seed in range(20):
        end, least = seconds_of(order, seed)
        assert least <= end < 1.02 * least


def test_scenes_are_complete_one_after_another_but_for_the_last_two() -> None:
    scenes = [cell.scene for cell in cells_of(5)]
    assert scenes[:15] == [scene for scene in "012" for _ in range(5)]
    assert sorted(scenes[15:]) == ["3"] * 5 + ["4"] * 5


def test_cells_that_train_a_stage_for_others_come_first_at_the_end() -> None:
    last = cells_of(2)
    firsts = [cell.first_key for cell in last]
    assert len(set(firsts[:4])) == 4
    assert [cell.scene for cell in last[4:]] == ["0"] * 3 + ["1"] * 3


@pytest.mark.parametrize("place", [0, 1])
def test_a_cell_waits_for_the_process_that_trains_its_next_stage(tmp_path: Path, place: int) -> None:
    store, cell = Store(tmp_path), fake_cell()
    for stage in cell.stages[:place]:
        store.put_tensors(product_name(stage.key), {})
    assert not waits_for_others(store, cell)
    with store.claim(stage_claim(cell.stages[1 - place].key)):
        assert not waits_for_others(store, cell)
    with store.claim(stage_claim(cell.stages[place].key)):
        assert waits_for_others(store, cell)
    assert not waits_for_others(store, cell)


def test_a_cell_that_waits_is_not_announced_and_is_taken_up_as_soon_as_it_can_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Another process trains what the first two cells share, and has done so when the third has been run."""
    sweep = FakeSweep(tmp_path)
    blocked, later = (fake_cell(seed=0), fake_cell(seed=0, protocol="irgs")), fake_cell(seed=1)
    last = fake_cell(seed=2)
    claim = sweep.store.claim(stage_claim(blocked[0].first_key))
    claim.__enter__()
    one, order = sweep.one, []

    def run(cell: Cell) -> None:
        order.append(cell)
        one(cell)
        if cell is later:
            claim.__exit__(None, None, None)

    sweep.one = run  # type: ignore[method-assign]
    assert sweep.run([*blocked, later, last]) == []
    assert order == [later, *blocked, last]
    assert capsys.readouterr().err.count(": started") == 4
