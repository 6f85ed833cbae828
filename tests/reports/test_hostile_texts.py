"""Names and titles stay text in every report: LaTeX compiles, and no markup comes from a name."""

import re
from typing import Any

import pytest

from made_up_run import summary
from radiogs_reports.run_folder import texts
from radiogs_reports.summary import Summary
from radiogs_reports.write.latex import LATIN, escape

HOSTILE = "ω 漢字 \u202e <script>alert(1)</script> ![x](http://x/y) \\input{/etc/passwd} \\write18{ls} | a\nb % $ {"


def hostile() -> Summary:
    """The made-up run with such a text wherever a person may put one."""
    made: Any = summary()
    made["title"] = made["published_data"] = made["machine"] = HOSTILE
    made["scenes"] = [HOSTILE]
    for row in made["rows"]:
        row["text"], row["latex"] = HOSTILE, ""
    for each in (*made["sheet"], *made["runs"]):
        each["scene"] = HOSTILE
    for table in made["paper"]:
        table["title"] = table["data"] = HOSTILE
        for row in table["rows"]:
            row["text"] = row["remark"] = HOSTILE
    for row in made["cells"].values():
        for cell in row.values():
            cell["reason"] = HOSTILE if cell["mean"] is None else None
    made["doubts"] = [{"column": "nvs/psnr", "rows": ["ours"], "text": HOSTILE}]
    return made  # type: ignore[no-any-return]


@pytest.fixture(scope="module")
def reports() -> dict[str, str]:
    return texts(hostile())


def test_pdflatex_knows_every_character(reports: dict[str, str]) -> None:
    """Audit M29: ``report.tex`` did not compile with an omega or CJK in a row's text."""
    documents = {name: text for name, text in reports.items() if name.endswith(".tex")}
    assert {"report.tex", "ablations_table.tex", "tables/strategies.tex"} <= documents.keys()
    assert r"$\omega$" in documents["ablations_table.tex"]
    assert r"\texttt{U+6F22}" in documents["ablations_table.tex"]
    for name, text in documents.items():
        strange = {each for each in text if not (each == "\n" or 32 <= ord(each) < 127 or ord(each) in LATIN)}
        assert not strange, (name, strange)


def test_no_command_of_latex_comes_from_a_text(reports: dict[str, str]) -> None:
    for name, text in reports.items():
        if name.endswith(".tex"):
            assert "\\write" not in text, name
            assert set(re.findall(r"\\input\{(.*?)\}", text)) <= reports.keys(), name


def test_markdown_has_no_tags_links_or_pictures_and_no_broken_rows(reports: dict[str, str]) -> None:
    """Audit M29: ``<script>`` stood in it as it was."""
    documents = {name: text for name, text in reports.items() if name.endswith(".md")}
    assert {"ablations.md", "tables/strategies.md"} <= documents.keys()
    for name, text in documents.items():
        assert "<" not in text, name
        assert "](" not in text, name
        widths = {len(re.findall(r"(?<!\\)\|", line)) for line in text.splitlines() if line.startswith("|")}
        assert len(widths) == 1, (name, widths)


def test_a_line_break_cannot_end_a_comment() -> None:
    assert "\n" not in escape("% title\n\\input{x}")
