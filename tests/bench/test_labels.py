"""Labels of methods stand below tables once, with the rows that they are of."""

from typing import Any

from radiogs_bench.results.labels import labels

SWEEP: Any = {"rows": [{"key": "ours", "text": "Ours"}, {"key": "a", "text": "A"}, {"key": "b", "text": "B"}]}


def cell(row: str, **facts: Any) -> Any:
    return {"row": row}, {"facts": facts}


def test_rows_with_the_same_labels_share_a_remark() -> None:
    own, other = {"stage1": "shared", "reduced": "rays 8"}, {"stage1": "shared"}
    cells = [cell("ours", surfels=3), cell("a", labels=own), cell("a", labels=own), cell("b", labels=own),
             cell("b", labels=other)]  # fmt: skip
    assert labels(cells, SWEEP) == [
        {"column": "", "rows": ["a", "b"], "text": "A, B: stage1: shared; reduced: rays 8."},
        {"column": "", "rows": ["b"], "text": "B: stage1: shared."},
    ]


def test_without_labels_or_results_there_is_no_remark() -> None:
    assert labels([cell("ours", surfels=3), cell("a", labels={}), ({"row": "b"}, None)], SWEEP) == []  # type: ignore[list-item]
