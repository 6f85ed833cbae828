"""Names and titles stay text in every report: LaTeX compiles, and no markup comes from a name."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from compiled import pdflatex
from made_up_run import summary
from radiogs_reports.run_folder import texts
from radiogs_reports.summary import Summary
from radiogs_reports.write.camera_ready import camera_ready
from radiogs_reports.write.latex import END, LATIN, PREAMBLE, escape
from radiogs_reports.write.mathematics import ACCENTS, FONTS, LETTERS, WIDE, is_mathematics

HOSTILE = "ω 漢字 \u202e <script>alert(1)</script> ![x](http://x/y) \\input{/etc/passwd} \\write18{ls} | a\nb % $ {"

LATEX = (
    r"\input{/etc/hostname}", r"\immediate\write18{ls}", r"\openin5=/etc/hostname", r"\csname input\endcsname",
    r"\catcode`\@=11", "^^5cinput{/etc/hostname}", r"$\input{/etc/hostname}$", "$x^^5cinput$", r"$\text{\include{x}}$",
    r"\te\%t{\include{x}}", r"\loop\iftrue\repeat", r"\def\x{\x}\x", r"\\\end{tabular}", "a & b", "x %", "$x", "{", "}",
    "$x^$", "$x^2^3$", r"$\frac{a}$", "a_b", "[a]", "* a", "a\nb", "漢", "$" + "{" * 300 + "}" * 300 + "$",
)  # fmt: skip
"""Labels of rows that are more than mathematics, or that pdflatex refuses."""

TOKENS = [
    *(rf"\{name}" for name in (*LETTERS, *WIDE)), *(rf"\{name}{{" for name in (*FONTS, *ACCENTS, "frac", "text")),
    *"abx12 {}}}$$_^+-=()[]*,.'\"|~&%#!é", r"\,", r"\%", r"\_", r"\;",
]  # fmt: skip
"""Labels by chance are made of these."""

MATHEMATICS = (
    "", r"$\lambda_{rad}=0$ (recommended)", r"Detach $L_\mathbf{G}^\mathbf{PBR}$", r"50\,\%, $\times0.5=32$", "Größe*",
    r"$\frac{1}{\sqrt{x_{i^2}}} \leq 1{,}000$", r"$\hat{x}_{\text{a b}}$",
)  # fmt: skip


def hostile() -> Summary:
    """The made-up run with such a text wherever a person may put one."""
    made: Any = summary()
    made["title"] = made["published_data"] = made["machine"] = HOSTILE
    made["scenes"] = [HOSTILE]
    for row in made["rows"]:
        row["text"], row["latex"] = HOSTILE, LATEX[0]
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


@pytest.mark.parametrize("latex", LATEX)
def test_a_label_beyond_mathematics_is_replaced_by_the_rows_text(latex: str) -> None:
    made = summary()
    for row in made["rows"]:
        row["latex"] = latex
    plain = summary()
    for row in plain["rows"]:
        row["latex"] = ""
    assert not is_mathematics(latex)
    assert texts(made) == texts(plain)
    assert camera_ready(made) == camera_ready(plain)


@pytest.mark.parametrize("latex", MATHEMATICS)
def test_a_label_of_mathematics_stays_as_it_is(latex: str) -> None:
    made = summary()
    made["rows"][0]["latex"] = latex
    assert is_mathematics(latex)
    assert latex in texts(made)["ablations_table.tex"]


def test_pdflatex_compiles_every_label_that_counts_as_mathematics(tmp_path: Path) -> None:
    rng, labels = np.random.default_rng(0), [*MATHEMATICS]
    while len(labels) < 300:
        label = "".join(rng.choice(TOKENS, rng.integers(1, 8)))
        labels += [each for each in (label, f"${label}$") if is_mathematics(each)]
    document = PREAMBLE + "\n\n".join(f"- {each}" for each in labels) + END
    (tmp_path / "labels.tex").write_text(document, encoding="utf-8")
    pdflatex("labels.tex", tmp_path)


def test_markdown_has_no_tags_links_or_pictures_and_no_broken_rows(reports: dict[str, str]) -> None:
    """Audit M29: it contained ``<script>`` unescaped."""
    documents = {name: text for name, text in reports.items() if name.endswith(".md")}
    assert {"ablations.md", "tables/strategies.md"} <= documents.keys()
    for name, text in documents.items():
        assert "<" not in text, name
        assert "](" not in text, name
        widths = {len(re.findall(r"(?<!\\)\|", line)) for line in text.splitlines() if line.startswith("|")}
        assert len(widths) == 1, (name, widths)


def test_a_line_break_cannot_end_a_comment() -> None:
    assert "\n" not in escape("% title\n\\input{x}")
