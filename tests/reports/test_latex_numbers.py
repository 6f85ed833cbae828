"""Numbers are aligned at their decimal points, and entries that are not numbers are set as text."""

import pytest

from made_up_run import summary
from radiogs_reports.tables.suite import suite_table
from radiogs_reports.write.numbers import MOST_ACROSS, MOST_LINES, Entry, Group, TabularLine, layout, parts, tabulars
from radiogs_reports.write.suite import suite_latex


@pytest.mark.parametrize(
    ("numbers", "table_format"),
    [
        (["31.2", "7.503"], "2.3"),
        (["31.2", "-1.23"], "-2.2"),
        (["+0.5", "12"], "-2.1"),
        (["n/a", "1e-05", "128"], "3.0"),
        (["n/a"], "1.0"),
        ([], "1.0"),
    ],
)
def test_a_column_has_room_for_the_most_digits_on_both_sides(numbers: list[str], table_format: str) -> None:
    assert layout(map(Entry, numbers)) == rf"S[table-format={table_format}]@{{\,}}l"


def test_siunitx_prints_the_plus_of_a_gain() -> None:
    made = summary()
    difference = made["cells"]["no-rad"]["nvs/psnr"]["difference"]
    assert difference is not None
    difference["mean"] = 0.58
    text = suite_latex(suite_table(made))
    assert text.index("retain-explicit-plus=true") < text.index(r"\scriptsize +0.58 &")


def test_text_that_siunitx_cannot_align_is_braced() -> None:
    entries = [Entry("1.5", r"\x "), Entry("n/a$^{a}$", r"\x "), Entry("1e-05"), Entry(), Entry("2", "", "(3)")]
    assert TabularLine("row", entries).text() == r"row & \x 1.5 &  & {\x n/a$^{a}$} &  & {1e-05} &  &  &  & 2 & (3) \\"
    assert [bool(entry) for entry in entries] == [True, True, True, False, True]


@pytest.mark.parametrize("count", range(1, 30))
def test_columns_that_do_not_fit_continue_below_in_order(count: int) -> None:
    columns = list(range(count))
    cut = [columns[part] for part in parts(count)]
    assert [column for part in cut for column in part] == columns
    assert max(map(len, cut)) <= MOST_ACROSS
    assert len(cut) == -(-count // MOST_ACROSS)
    assert max(map(len, cut)) - min(map(len, cut)) <= len(cut)


def test_a_difference_keeps_to_its_row_and_a_line_without_values_is_left_out() -> None:
    """Two rows of eight numbers, of which the second has one difference, to the last."""
    values = [Entry(str(place)) for place in range(8)]
    difference = TabularLine("difference", [Entry()] * 7 + [Entry("-1")])
    groups = [Group([TabularLine("one", values)]), Group([TabularLine("two", values), difference])]
    text = "\n".join(tabulars("l", "tab:a", lambda part: [str(part)], [*groups, Group([difference], "apart")]))
    upper, lower = text.split(r"\par" + "\n")
    assert [part.count(r"\begin{tabular}") for part in (upper, lower)] == [1, 1]
    assert "difference" not in upper
    assert "apart" not in upper
    assert r"\addlinespace" not in upper
    assert lower.index("one") < lower.index(r"\addlinespace") < lower.index("two") < lower.index("difference")
    assert rf"\multicolumn{{{1 + 2 * 4}}}{{l}}{{apart}}" in lower


def test_parts_that_do_not_fit_on_a_page_are_tables_of_their_own() -> None:
    entries = [Entry("1")] * (3 * MOST_ACROSS)
    for rows, tables in ((MOST_LINES // 3, 1), (MOST_LINES // 2, 2), (MOST_LINES // 2 + 1, 3)):
        text = "\n".join(
            tabulars("l", "tab:a", lambda part: [str(part)], [Group([TabularLine("row", entries)])] * rows)
        )
        assert text.count(r"\begin{tabular}") == 3
        assert text.count(r"\end{table}") == text.count(r"Table~\ref{tab:a}, continued") == tables - 1
