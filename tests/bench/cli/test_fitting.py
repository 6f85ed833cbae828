"""A suite's table in a narrow terminal: in parts, with every number whole."""

import io

import pytest
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from made_up_run import summary
from radiogs_bench.cli.reporter import show
from radiogs_bench.cli.showing import below, parts_of
from radiogs_reports.summary import Summary
from radiogs_reports.tables.suite import suite_table


def parts(made: Summary, width: int) -> list[Table]:
    return parts_of(suite_table(made), width)


def printed(made: Summary, width: int) -> str:
    text = io.StringIO()
    console = Console(width=width, file=text)
    for table in parts(made, width):
        console.print(table)
    return text.getvalue()


@pytest.mark.parametrize("width", [40, 60, 80, 120, 160])
def test_no_number_is_cut_at_any_width(width: int) -> None:
    made = summary()
    text = printed(made, width)
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width
    for row in made["cells"].values():
        for column in made["columns"]:
            mean = row[column["key"]]["mean"]
            assert mean is None or f"{mean:.{column['decimals']}f}" in text


def test_columns_that_fit_are_one_table() -> None:
    assert len(parts(summary(), 160)) == 1
    assert len(parts(summary(), 40)) > 1


def test_a_column_that_is_too_wide_on_its_own_is_alone() -> None:
    made = summary()
    made["columns"][0]["label"] = "NVS " + "x" * 70
    assert len(parts(made, 80)) >= 2


def test_markup_in_a_label_is_text() -> None:
    made = summary()
    made["rows"][0]["text"] = "[bold]mine[/bold]"
    assert "[bold]mine[/bold]" in printed(made, 160)


def test_a_table_in_a_file_or_a_pipe_is_markdown(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table("name", "value", title="[b]A title[/b]")
    table.add_row(escape("[mine]|yours"), "1.5")
    show(table)
    said = capsys.readouterr().out.splitlines()
    assert said == ["A title", "", "| name | value |", "| --- | --- |", r"| [mine]\|yours | 1.5 |"]


def test_a_star_is_at_the_differences_that_are_resolved_and_nowhere_else() -> None:
    made = summary()
    assert "-1.23±0.50*" in printed(made, 160)
    difference = made["cells"]["no-rad"]["nvs/psnr"]["difference"]
    assert difference is not None
    difference["verdict"] = None
    assert "-1.23±0.50*" not in printed(made, 160)
    assert "-1.23±0.50" in printed(made, 160)


def test_below_the_table_stand_the_smallest_differences_and_why_values_are_missing() -> None:
    made = summary()
    made["columns"][0]["smallest"] = 0.2
    lines = below(suite_table(made))
    assert any(line.startswith("The median row resolves differences from about: NVS PSNR 0.20 dB") for line in lines)
    assert any(line.startswith("n/a in NVS LPIPS: ") for line in lines)
