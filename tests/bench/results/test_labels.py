"""Labels of methods stand below tables once, with the rows, and where they differ the scenes, that they are of."""

from typing import Any

from radiogs_bench.results.doubts import labels

SWEEP: Any = {"rows": [{"key": "ours", "text": "Ours"}, {"key": "a", "text": "A"}, {"key": "b", "text": "B"}]}


def cell(row: str, scene: str = "corner", method: str = "surfels", **facts: Any) -> Any:
    return {"row": row, "scene": scene}, {"facts": facts, "cell": {"method": method}}


def texts(*cells: Any) -> list[str]:
    return [found["text"] for found in labels(cells, SWEEP)]


def test_rows_with_the_same_labels_share_a_remark() -> None:
    own = {"stage1": "shared", "reduced": "rays 8"}
    cells = [cell("ours", surfels=3), cell("a", labels=own), cell("a", labels=own), cell("b", labels=own)]
    assert labels(cells, SWEEP) == [
        {"column": "", "rows": ["a", "b"], "text": "A, B: stage1: shared; reduced: rays 8."},
    ]


def test_labels_that_all_rows_of_a_method_share_are_stated_once() -> None:
    both, one = {"stage1": "shared", "reduced": "rays 8"}, {"stage1": "shared"}
    assert texts(cell("a", labels=both), cell("b", labels=one)) == ["A, B: stage1: shared.", "A: reduced: rays 8."]
    assert texts(cell("a", labels=both), cell("b", method="field", labels=one)) == [
        "A: stage1: shared; reduced: rays 8.", "B: stage1: shared.",
    ]  # fmt: skip


def test_a_label_that_differs_between_scenes_is_one_remark_that_names_them() -> None:
    cells = [cell("a", scene, labels={"stage1": "shared", "hop": hop})
             for scene, hop in (("corner", "0.2"), ("bowl", "0.3"), ("box", "0.3"))]  # fmt: skip
    assert texts(*cells) == ["A: stage1: shared; hop: 0.2 (corner), 0.3 (bowl, box)."]
    assert texts(cells[0], cell("a", "box", labels={"stage1": "shared"})) == ["A: stage1: shared; hop: 0.2 (corner)."]


def test_without_labels_or_results_there_is_no_remark() -> None:
    nothing: Any = ({"row": "b", "scene": "corner"}, None)
    assert labels([cell("ours", surfels=3), cell("a", labels={}), nothing], SWEEP) == []
