import re
from pathlib import Path

import pytest

from radiogs.errors import UsageError
from radiogs_baselines.published import published, published_tables


def test_every_table_has_its_columns_filled_and_directed() -> None:
    for key in published_tables():
        table = published(key)
        for row in table.figures.values():
            assert set(row) <= set(table.columns)
        assert {column.direction for column in table.columns.values()} <= {"up", "down"}


def test_an_unknown_table_is_told_its_neighbours() -> None:
    with pytest.raises(UsageError, match="Did you mean 'ablation'"):
        published("ablations")


def test_the_ablation_is_the_papers_own(shared_data: Path) -> None:
    papers = sorted((shared_data.parent / "paper").glob("*.txt"))
    if not papers:
        pytest.skip("the paper's LaTeX is not at hand")
    text = papers[0].read_text(errors="replace")
    start = text.index(r"\makecell{NVS} & \makecell{Albedo}")
    body = text[start : text.index(r"\end{tabular}", start)]
    printed = re.findall(r"(\d\d\.\d\d)", body)
    rows = published("ablation").figures
    assert [f"{value:.2f}" for key in rows for value in rows[key].values()] == printed
