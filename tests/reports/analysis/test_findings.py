"""Findings above a table: what is resolved, what could have been, and the paper's differences beside it."""

import re
from collections.abc import Callable
from html import unescape

import pytest

from made_up_run import cell, summary
from made_up_run import paper_table as stored_table
from radiogs_bench.results.paper_tables import interval
from radiogs_reports.analysis.comparisons import Direction, to_reference
from radiogs_reports.analysis.findings import (
    MeasuredDifference,
    Outcome,
    compared_paper,
    compared_run,
    differences_of,
    headline,
    sentences_of,
)
from radiogs_reports.page.assemble import page
from radiogs_reports.page.pictures import Album
from radiogs_reports.statistics import Origin, Sample
from radiogs_reports.summary import Interval, Summary
from radiogs_reports.tables.paper import paper_table
from radiogs_reports.tables.suite import suite_table
from radiogs_reports.write.paper import paper_latex, paper_markdown
from radiogs_reports.write.suite import suite_latex, suite_markdown


def difference(made: Summary, row: str, column: str) -> Interval:
    found = made["cells"][row][column]["difference"]
    assert found is not None
    return found


def findings(made: Summary) -> list[MeasuredDifference]:
    return differences_of(compared_run(made))


def sentences(made: Summary) -> list[str]:
    return [each.plain for each in sentences_of(compared_run(made))]


def three_rows() -> Summary:
    """PSNR: one row resolved as published, one not resolved; normals: resolved the other way, and not resolved."""
    made = summary()
    made["rows"].append({"key": "detach", "latex": r"Detach $L_G$", "text": "Detach L_G", "seconds": 50.0})
    made["cells"]["detach"] = {
        "nvs/psnr": cell(31.0, -0.234), "normal/mae": cell(7.6, 0.1), "nvs/lpips": cell(None, reason="no_weights"),
    }  # fmt: skip
    made["published"] = {
        "ours": {"nvs/psnr": 37.86, "normal/mae": 4.0},
        "no-rad": {"nvs/psnr": 35.82, "normal/mae": 4.5},
        "detach": {"nvs/psnr": 37.46, "normal/mae": 4.05},
    }
    return made


BY_ROW = [
    "lambda_rad = 0, resolved: NVS PSNR -1.23 dB [-1.73, -0.73] (paper -2.04, sign holds);"
    " Normal MAE -0.50 degrees [-1.00, 0.00] (paper +0.50, sign does not hold).",
    "Detach L_G, not resolved: NVS PSNR -0.23 dB [-0.73, +0.27] (could show 0.20, paper -0.40);"
    " Normal MAE +0.10 degrees [-0.40, +0.60] (could show 0.20, paper +0.05)."
    " Too small for this run at the paper's size: Normal MAE.",
]


def test_the_sentences_list_resolved_and_resolvable_differences() -> None:
    counts, how_to_read, paper, *rows = sentences(three_rows())
    assert counts == (
        "2 of 4 differences are resolved (larger than chance explains); the paper's sign holds in 1, does not hold in"
        " 1, and is not resolved in 2 of the 4 differences that the paper reports."
    )
    assert "95 % intervals" in how_to_read
    assert paper == "Paper: its difference, on TensoIR, four scenes (here on my_scene)."
    assert rows == BY_ROW


def seeds(*values: float) -> Sample:
    return {Origin("ball", seed): value for seed, value in enumerate(values)}


FAR, NEAR = (1.0, 1.1, 0.9), (1.0, -1.2, 0.3)
"""Differences by seed that are resolved, and that are not."""


@pytest.mark.parametrize(
    ("direction", "shifts", "published", "expected"),
    [
        ("up", FAR, 21.0, "holds"),
        ("up", FAR, 19.0, "does not hold"),
        ("up", NEAR, 21.0, "not resolved"),
        ("up", FAR, 20.0, None),
        ("down", FAR, 21.0, "holds"),
        ("down", FAR, 19.0, "does not hold"),
        ("down", tuple(-each for each in FAR), 19.0, "holds"),
        ("down", NEAR, 19.0, "not resolved"),
        ("zero", FAR, 21.0, "holds"),
        ("zero", FAR, -19.0, "does not hold"),
        ("zero", FAR, -21.0, "holds"),
    ],
)
def test_the_papers_sign_is_compared_in_the_direction_of_better_values(
    direction: Direction, shifts: tuple[float, ...], published: float, expected: Outcome | None
) -> None:
    ours = seeds(30.0, 33.0, 36.0)
    row = {origin: value + shift for (origin, value), shift in zip(ours.items(), shifts, strict=True)}
    made = summary()
    made["columns"][0]["direction"] = direction
    made["published"] = {"ours": {"nvs/psnr": 20.0}, "no-rad": {"nvs/psnr": published}}
    compared = to_reference({"ours": ours, "no-rad": row}, "ours", direction)
    made["cells"]["no-rad"]["nvs/psnr"]["difference"] = interval(compared, "no-rad")
    found = next(each for each in findings(made) if each.column == "nvs/psnr")
    assert (found.row, found.verdict, found.resolved) == ("no-rad", expected, shifts is not NEAR)
    assert found.published == published - 20.0
    assert found.smallest == difference(made, "no-rad", "nvs/psnr")["smallest"]


@pytest.mark.parametrize(("smallest", "too_small"), [(2.03, False), (2.05, True), (None, False)])
def test_a_published_difference_is_too_small_if_the_row_itself_could_not_have_shown_it(
    smallest: float | None, too_small: bool
) -> None:
    made = summary()
    difference(made, "no-rad", "nvs/psnr").update(verdict=None, smallest=smallest)
    assert [each.too_small for each in findings(made)] == [too_small, False]
    difference(made, "no-rad", "nvs/psnr").update(verdict="worse")
    assert not any(each.too_small for each in findings(made)), "it has shown one"


@pytest.mark.parametrize(("high", "smallest", "excluded"), [(-2.1, 2.0, True), (-2.0, 2.0, False), (-2.1, 2.1, False)])
def test_the_papers_size_is_excluded_where_the_interval_ends_before_it_and_the_run_could_have_shown_it(
    high: float, smallest: float, excluded: bool
) -> None:
    made = summary()
    difference(made, "no-rad", "nvs/psnr").update(verdict=None, low=-2.3, high=high, smallest=smallest)
    assert [each.excluded for each in findings(made)] == [excluded, False]
    assert any("The interval excludes the paper's size: NVS PSNR." in each for each in sentences(made)) == excluded


def test_one_scene_and_seed_resolves_nothing() -> None:
    made = summary()
    for column in ("nvs/psnr", "normal/mae"):
        difference(made, "no-rad", column).update(
            low=None, high=None, p_value=None, verdict=None, units=1, smallest=None
        )
    counts, paper, row = sentences(made)
    assert counts == "One scene and one seed: no difference can be resolved."
    assert paper.startswith("Paper: ")
    assert row == "lambda_rad = 0, not resolved: NVS PSNR -1.23 dB (paper -2.04); Normal MAE -0.50 degrees."


def test_conventions_of_published_values_are_named_once_and_columns_without_any_have_no_verdict() -> None:
    made = summary()
    made["columns"][0]["published_by"] = "radiogs"
    counts, _, paper, row = sentences(made)
    assert counts.endswith("of the 1 difference that the paper reports.")
    assert paper.endswith("(here on my_scene), by other conventions (protocol radiogs).")
    assert "(paper -2.04, sign holds)" in row
    assert row.endswith("Normal MAE -0.50 degrees [-1.00, 0.00].")
    made["published"] = {}
    assert sentences(made)[0] == "2 of 2 differences are resolved (larger than chance explains)."
    assert all(each.published is None and each.verdict is None for each in findings(made))


@pytest.mark.parametrize("row", ["ours", "no-rad"])
def test_a_difference_that_a_footnote_concerns_is_left_out_as_the_table_leaves_out_its_colour(row: str) -> None:
    made = summary()
    made["doubts"] = [{"column": "nvs/psnr", "rows": [row], "text": "not determined"}]
    doubted, other = findings(made)
    assert (doubted.resolved, doubted.verdict, doubted.doubted) == (False, None, True)
    assert (other.resolved, other.doubted) == (True, False)
    counts, *_, last = sentences(made)
    assert counts == "1 of 1 difference is resolved (larger than chance explains)."
    assert last == "Left out, because a footnote of this run concerns them: 1 difference of NVS PSNR."


def test_rows_without_a_reference_row_have_no_findings() -> None:
    made = summary()
    made["reference"] = None
    assert findings(made) == []
    assert sentences(made) == []
    assert "<li>" not in on_page(made)


def test_a_small_difference_is_not_said_to_be_zero() -> None:
    made = summary()
    difference(made, "no-rad", "nvs/psnr").update(mean=-0.00123, low=-0.002, high=-0.0004)
    assert "NVS PSNR -0.0012 dB [-0.0020, -0.0004]" in sentences(made)[-1], "with one number of decimals"


def test_a_table_of_the_paper_has_findings_with_its_own_decimals_and_without_settings() -> None:
    stored = stored_table()
    samples = stored["cells"]["detach"]["relight/samples"]
    samples["difference"] = stored["cells"]["detach"]["nvs/lpips"]["difference"]
    counts, _, paper, resolved, open_ = (each.plain for each in sentences_of(compared_paper(stored, summary())))
    assert counts.startswith(
        "1 of 2 differences is resolved (larger than chance explains); the paper's sign holds in 1,"
    )
    assert "TensoIR_Ind" in paper
    assert resolved == "Detach L_G^PBR, resolved: NVS PSNR -1.500 dB [-2.000, -1.000] (paper -0.606, sign holds)."
    assert "NVS LPIPS 0.0000 [-0.5000, +0.5000] (could show 0.2000, paper +0.0009)" in open_
    assert "Relight N" not in open_
    table = paper_table(stored_table(), summary())
    assert resolved in paper_markdown(table)
    assert r"Detach $L_\mathrm{G}^\mathrm{PBR}$ is worse than" in caption_of(paper_latex(table))
    assert r"Detach $L_\mathrm{G}^\mathrm{PBR}$, resolved: NVS PSNR $-$1.500 dB" in paper_latex(table)


def on_page(made: Summary) -> str:
    """The table of means and everything below it that belongs to it."""
    text = page(made, Album())
    return text[text.index('id="table-means"') : text.index('id="cells"')]


def caption_of(latex: str) -> str:
    (caption,) = re.findall(r"\\caption\{(.*)\}\n\\label", latex)
    return str(caption)


def in_markdown(made: Summary) -> list[str]:
    above, _ = suite_markdown(suite_table(made), "").split("\n| ", maxsplit=1)
    return [line.removeprefix("- ") for line in above.splitlines()]


def in_page(made: Summary) -> list[str]:
    items = re.findall(r"<li>(.*?)</li>", on_page(made))
    return [unescape(re.sub(r"<i>(.)</i><sub>(\w+)</sub>", r"\1_\2", item)) for item in items]


@pytest.mark.parametrize("shown", [in_markdown, in_page])
def test_every_report_has_the_same_sentences(shown: Callable[[Summary], list[str]]) -> None:
    made = three_rows()
    lines = shown(made)
    start = lines.index(sentences(made)[0])
    assert lines[start : start + len(sentences(made))] == sentences(made)


def in_plain_text(latex: str) -> str:
    labels = {r"$\lambda_{rad}=0$": "lambda_rad = 0", "Detach $L_G$": "Detach L_G"}
    for label, text in {**labels, "$-$": "-", r"\%": "%", r"\_": "_"}.items():
        latex = latex.replace(label, text)
    return latex


def test_latex_has_the_headline_in_its_caption_and_all_sentences_below_the_table() -> None:
    made = three_rows()
    table, below_it = suite_latex(suite_table(made)).split(r"\end{table}")
    assert in_plain_text(caption_of(table)).endswith(" ".join(headline(compared_run(made))))
    for sentence in sentences(made):
        assert rf"\par {sentence}" in in_plain_text(below_it)
    assert r"\par $\lambda_{rad}=0$, resolved: NVS PSNR $-$1.23 dB [$-$1.73, $-$0.73] (paper $-$2.04" in below_it


def test_the_headline_names_what_the_first_row_resolves_and_the_papers_values_of_the_rest() -> None:
    first, counts = headline(compared_run(three_rows()))
    assert first == (
        "lambda_rad = 0 is worse than Ours by 1.23 dB of NVS PSNR (0.73 to 1.73; paper 2.04) and better than Ours by"
        " 0.50 degrees of Normal MAE (0.00 to 1.00; paper 0.50 the other way)."
    )
    assert counts == sentences(three_rows())[0]


def test_a_difference_unresolved_by_the_correction_alone_is_named_so_and_the_headline_has_the_papers() -> None:
    made = three_rows()
    difference(made, "no-rad", "nvs/psnr")["verdict"] = None
    assert headline(compared_run(made))[0].endswith("This run could not tell them apart in NVS PSNR (paper -2.04).")
    (told,) = (each for each in sentences(made) if "excludes zero alone, not after correction for all rows" in each)
    assert told.startswith("lambda_rad = 0, not resolved: NVS PSNR -1.23 dB")
