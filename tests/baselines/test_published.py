"""The stored figures are the paper's own, cell by cell, as its LaTeX prints them."""

import re
import tomllib
from importlib import resources
from pathlib import Path

import pytest

from radiogs_baselines.published import published, published_tables, values_beside
from radiogs_core.errors import UsageError

TABLES = published_tables()
IN_TWO_DIRECTIONS = "views"
"""Prints its rows' methods side by side; the stored table has a row for each."""


@pytest.fixture
def paper(shared_data: Path) -> str:
    sources = sorted((shared_data.parent / "paper").glob("*.txt"))
    if not sources:
        pytest.skip("the paper's LaTeX is not at hand")
    return sources[0].read_text(errors="replace")


def tabular(paper: str, label: str) -> str:
    """The tabular that a label belongs to: in tables it follows the label, in figures it precedes it."""
    place = paper.index(rf"\label{{{label}}}")
    begin = (
        paper.rindex(r"\begin{tabular}", 0, place)
        if label.startswith("fig:")
        else paper.index(r"\begin{tabular}", place)
    )
    return paper[begin : paper.index(r"\end{tabular}", begin)]


def printed(paper: str, label: str) -> list[list[list[str]]]:
    """Figures of every cell of every row but headings, first column left out; multirow cells in all their rows."""
    rows: list[list[list[str]]] = []
    reach: list[tuple[int, int, list[str]]] = []
    for line in tabular(paper, label).split(r"\\"):
        cells = line.split("&")
        if len(cells) < 3 or "arrow" in line or "textbf{NVS}" in line or "(ms)" in line or "multicolumn" in line:
            continue
        figures = []
        for cell in cells[1:]:
            if span := re.search(r"\\multirow\{(-?\d+)\}", cell):
                cell = cell.replace(span.group(0), "").replace("{*}", "")
            figures.append(re.findall(r"-?\d+(?:\.\d+)?", cell))
            if span:
                reach.append((len(rows), len(figures) - 1, figures[-1]))
                count = int(span.group(1))
                for step in range(1, abs(count)):
                    reach.append((len(rows) + (step if count > 0 else -step), len(figures) - 1, figures[-1]))
        if any(figures):
            rows.append(figures)
    for row, column, figures in reach:
        rows[row][column] = figures
    return rows


def stored(key: str) -> dict[str, dict[str, str]]:
    """The rows of a file with every figure as it is written there."""
    text = resources.files("radiogs_baselines.published").joinpath(f"{key}.toml").read_text(encoding="utf-8")
    rows = tomllib.loads(text, parse_float=str)["rows"]
    return {row: {column: str(figure) for column, figure in figures.items()} for row, figures in rows.items()}


@pytest.mark.parametrize("key", [key for key in TABLES if key != IN_TWO_DIRECTIONS])
def test_every_cell_is_printed_so_in_the_paper(paper: str, key: str) -> None:
    table = published(key)
    expected = [
        {column: figures[0] for column, figures in zip(table.columns, row, strict=True) if figures}
        for row in printed(paper, table.label)
    ]
    assert list(stored(key).values()) == expected


def test_the_table_of_training_views_is_printed_so(paper: str) -> None:
    rows = stored(IN_TWO_DIRECTIONS)
    expected = {}
    for share, cells in zip((100, 50, 25), printed(paper, published(IN_TWO_DIRECTIONS).label), strict=True):
        for place, method in enumerate(("ours", "no-rad")):
            columns = ["nvs/psnr", "indirect/psnr", "nvs/change", "indirect/change"]
            figures = [*(cells[place + group][0] for group in (0, 2)), *(cells[place + group][-1] for group in (0, 2))]
            kept = columns[: 2 if share == 100 else 4]
            expected[f"{method}-{share}"] = dict(zip(kept, figures, strict=False))
    assert rows == expected


def test_no_table_of_the_paper_is_missing(paper: str) -> None:
    uncommented = re.sub(r"(?m)^\s*%.*$", "", paper)
    assert len(re.findall(r"\\begin\{tabular\}", uncommented)) == len(TABLES)


@pytest.mark.parametrize("key", TABLES)
def test_every_table_is_complete(key: str) -> None:
    table = published(key)
    assert table.title
    assert table.data
    assert table.source
    assert table.labels.keys() == table.figures.keys()
    assert table.remarks.keys() <= table.figures.keys()
    for row, figures in table.figures.items():
        lacking = table.columns.keys() - figures.keys()
        assert lacking == table.absent.get(row, {}).keys()
        assert figures.keys() <= table.columns.keys()
    assert {column.direction for column in table.columns.values()} <= {"up", "down", "none"}


@pytest.mark.parametrize("key", TABLES)
def test_units_and_directions_follow_the_measure(key: str) -> None:
    better = {"psnr": "up", "ssim": "up", "change": "up", "samples": "none"}
    units = {"psnr": "dB", "change": "dB", "mae": "deg", "ms": "ms", "hours": "h", "megabytes": "MB", "samples": "rays"}
    for name, column in published(key).columns.items():
        _, measure, *scene = name.split("/")
        assert column.direction == better.get(measure, "down")
        assert column.unit == units.get(measure, "")
        assert [column.scene] == (scene or [None])


@pytest.mark.parametrize("key", ["mipnerf360-ng", "mipnerf360-ns"])
def test_averages_equal_means_over_scenes_or_have_a_remark(key: str) -> None:
    table = published(key)
    scenes = [name for name, column in table.columns.items() if column.scene is not None]
    for row, figures in table.figures.items():
        mean = sum(figures[name] for name in scenes) / len(scenes)
        agrees = abs(figures["nvs/ms"] - mean) <= 0.00501
        assert agrees != (row in table.remarks)


def test_tables_that_print_the_same_model_agree_to_the_coarser_ones_digits() -> None:
    coarse = published("ablation").figures
    for table in ("tensoir", "init", "strategies"):
        for row in coarse.keys() & published(table).figures.keys():
            for column in coarse[row].keys() & published(table).figures[row].keys():
                assert published(table).figures[row][column] == pytest.approx(coarse[row][column], abs=0.005)


def test_changes_are_differences_to_all_views() -> None:
    rows = published("views").figures
    for row, figures in rows.items():
        whole = rows[f"{row.rpartition('-')[0]}-100"]
        for task in ("nvs", "indirect"):
            if f"{task}/change" in figures:
                difference = figures[f"{task}/psnr"] - whole[f"{task}/psnr"]
                assert figures[f"{task}/change"] == pytest.approx(difference, abs=0.0101)


@pytest.mark.parametrize("key", TABLES)
def test_printed_figures_keep_the_papers_digits(key: str) -> None:
    table = published(key)
    assert table.printed == stored(key)
    assert {row: {name: float(text) for name, text in found.items()} for row, found in table.printed.items()} == (
        table.figures
    )


def test_an_unknown_table_lists_its_neighbours() -> None:
    with pytest.raises(UsageError, match="Did you mean 'ablation'"):
        published("ablations")


@pytest.mark.parametrize("key", TABLES)
def test_conditions_agree_with_the_data(key: str) -> None:
    table = published(key)
    assert table.data.endswith(f", mean of {', '.join(table.conditions.scenes)}")
    least, most = table.conditions.width
    assert 0 < least <= most
    of_one_scene = {column.scene for column in table.columns.values()} - {None}
    assert of_one_scene <= set(table.conditions.scenes)


def test_columns_that_the_ablation_lacks_have_the_values_of_the_table_of_indirect_light() -> None:
    figures, data = values_beside("ablation", ["nvs/psnr", "indirect/psnr", "roughness/mse"])
    assert figures["ours"]["nvs/psnr"] == 37.86
    assert figures["ours"]["indirect/psnr"] - figures["no-rad"]["indirect/psnr"] == pytest.approx(2.7878)
    assert "indirect/psnr" not in figures["nvs-init"]
    assert data.endswith(
        "; for columns that this table does not report, TensoIR_Ind, mean of armadillo, ficus, hotdog, lego"
    )
    assert values_beside(None, ["nvs/psnr"]) == ({}, "none for this suite")
