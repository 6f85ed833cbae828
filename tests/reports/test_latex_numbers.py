"""Numbers stand below each other by their decimal points, and what is no number is set as text."""

import pytest

from radiogs_reports.write.numbers import Entry, layout, line


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


def test_what_siunitx_cannot_align_is_braced() -> None:
    entries = [Entry("1.5", r"\x "), Entry("n/a$^{a}$", r"\x "), Entry("1e-05"), Entry(), Entry("2", "", "(3)")]
    assert line("row", entries, "last") == r"row & \x 1.5 &  & {\x n/a$^{a}$} &  & {1e-05} &  &  &  & 2 & (3) & last \\"
    assert [bool(entry) for entry in entries] == [True, True, True, False, True]
