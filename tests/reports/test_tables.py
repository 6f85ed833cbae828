"""The table model decides every text once: all renderers print its texts, and none computes numbers."""

import re
from collections.abc import Callable

import pytest
from rich.console import Console

from made_up_run import paper_table as stored_table
from made_up_run import summary
from radiogs_bench.cli.showing import parts_of
from radiogs_reports.page.assemble import page
from radiogs_reports.page.pictures import Album
from radiogs_reports.summary import Summary
from radiogs_reports.tables.model import Table
from radiogs_reports.tables.paper import apart_table, paper_table
from radiogs_reports.tables.suite import suite_table
from radiogs_reports.write.paper import paper_latex, paper_markdown
from radiogs_reports.write.suite import suite_latex, suite_markdown

NUMBER = re.compile(r"(?<![\w.])[+-]?\d+\.\d+")


def in_terminal(made: Summary) -> str:
    console = Console(width=200)
    with console.capture() as shown:
        for part in parts_of(suite_table(made), 200):
            console.print(part)
    return shown.get()


def on_page(made: Summary) -> str:
    """The text of the table of means, without its attributes."""
    (table,) = re.findall(r'<table class="sortable" data-name="means">.*?</table>', page(made, Album()), flags=re.S)
    return re.sub(r"<[^>]*>", " ", table)


def in_latex(made: Summary) -> str:
    """The body of the tabular, without the codes of its colours."""
    text = suite_latex(suite_table(made)).replace("[HTML]", "")
    body = "".join(re.findall(r"\\midrule(.*?)\\bottomrule", text, flags=re.S))
    return re.sub(r"\\cellcolor\{\w*\}|\$\\pm\$", " ", body)


def in_markdown(made: Summary) -> str:
    return "".join(line for line in suite_markdown(suite_table(made), "").splitlines() if line.startswith("|"))


RENDERERS: dict[str, Callable[[Summary], str]] = {
    "LaTeX": in_latex, "Markdown": in_markdown, "page": on_page, "terminal": in_terminal,
}  # fmt: skip
EACH = pytest.mark.parametrize("render", RENDERERS.values(), ids=RENDERERS)


def numbers_of(table: Table) -> set[str]:
    """Every number with a decimal point that the model has for the values of a table."""
    found = {cell.text for cell in table.cells} | {cell.published.text for cell in table.cells if cell.published}
    for difference in (cell.difference for cell in table.cells if cell.difference):
        found |= {difference.text, difference.half_width, difference.low, difference.high}
    return {text for text in found if NUMBER.fullmatch(text)}


@EACH
def test_a_renderer_prints_every_value_and_no_number_of_its_own(render: Callable[[Summary], str]) -> None:
    table, printed = suite_table(summary()), set(NUMBER.findall(render(summary())))
    assert printed <= numbers_of(table)
    values = {cell.text for cell in table.cells if cell.value is not None}
    differences = {cell.difference.text for cell in table.cells if cell.difference}
    published = {cell.published.text for cell in table.cells if cell.published}
    assert values | differences | published <= printed


@EACH
def test_a_published_value_of_zero_is_printed(render: Callable[[Summary], str]) -> None:
    made = summary()
    made["published"]["ours"]["normal/mae"] = 0.0
    assert render(made).count("0.00") == render(summary()).count("0.00") + 1


@EACH
def test_a_small_value_is_not_printed_as_zero(render: Callable[[Summary], str]) -> None:
    made = summary()
    made["cells"]["ours"]["normal/mae"]["mean"] = 0.00123
    assert "0.0012" in render(made)


@EACH
def test_a_difference_that_rounds_to_zero_has_no_sign(render: Callable[[Summary], str]) -> None:
    made = summary()
    difference = made["cells"]["no-rad"]["normal/mae"]["difference"]
    assert difference is not None
    difference.update(mean=-0.001, low=-0.201, high=0.199)
    assert re.search(r"(?<![\d.])0\.00(?!\d)", render(made))
    assert not re.search(r"[+-]0\.00(?!\d)", render(made))


@EACH
def test_a_row_that_was_not_trained_has_no_seconds_and_a_reason(render: Callable[[Summary], str]) -> None:
    made = summary()
    made["rows"][1]["seconds"] = None
    assert render(made).count("n/a") == render(summary()).count("n/a") + 1
    table = suite_table(made)
    assert table.missing["no finished cell of the row trained anything"] == ["Training"]
    assert "no finished cell of the row trained anything" in table.notes


def test_a_value_without_a_mean_has_no_mark() -> None:
    made = summary()
    made["doubts"] = [{"column": "nvs/lpips", "rows": ["ours"], "text": "not determined"}]
    assert {row.cells[2].marks for row in suite_table(made).rows} == {""}


def test_where_zero_is_best_a_value_sorts_by_its_magnitude() -> None:
    made = summary()
    made["columns"][0]["direction"] = "zero"
    made["cells"]["ours"]["nvs/psnr"]["mean"] = -31.234
    cell = suite_table(made).rows[0].cells[0]
    assert (cell.text, cell.value) == ("-31.23", 31.234)


def test_latex_and_markdown_number_the_notes_of_a_papers_table_alike() -> None:
    table = paper_table(stored_table(), summary())
    assert [*table.notes] == [
        "not in this store; 100 % lost & gone", "The paper prints a dash", "Printed otherwise in table 3",
    ]  # fmt: skip
    letters = re.findall(r"n/a\$\^\{(\w)\}\$", paper_latex(table))
    numbers = re.findall(r"n/a \[(\d+)\]", paper_markdown(table))
    assert [ord(letter) - ord("a") + 1 for letter in letters] == [int(number) for number in numbers]
    assert set(numbers) == {"1", "2"}


def test_a_papers_table_by_the_conventions_of_the_run_has_nothing_apart() -> None:
    table = paper_table(stored_table(), summary())
    assert table.apart_title == ""
    assert list(apart_table(table).columns) == []
    assert all(cell.apart is None for cell in table.cells)
