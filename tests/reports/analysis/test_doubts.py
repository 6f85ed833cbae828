"""Every report marks an uncertain value, and gives the reason below."""

import io

import pandas as pd

from made_up_run import summary
from radiogs_bench.cli.showing import parts_of
from radiogs_reports.page.assemble import page
from radiogs_reports.page.pictures import Album
from radiogs_reports.summary import Summary
from radiogs_reports.tables.doubts import footnotes, marks, remarks, texts_of
from radiogs_reports.tables.suite import suite_table
from radiogs_reports.write.suite import suite_csv, suite_latex, suite_markdown

LEVEL = "changing it by 0.1 changes the image by 0.01 dB"
CONSTANT = "no better than a constant & more"
REMARK = "brightness: no column depends on it"


def doubted() -> Summary:
    made = summary()
    made["doubts"] = [
        {"column": "normal/mae", "rows": ["ours", "no-rad"], "text": LEVEL},
        {"column": "normal/mae", "rows": ["no-rad"], "text": CONSTANT},
        {"column": "", "rows": ["ours"], "text": REMARK},
    ]
    return made


def test_only_the_rows_that_a_footnote_names_have_its_mark() -> None:
    made = doubted()
    assert marks(made, "ours", "normal/mae") == "†"
    assert marks(made, "no-rad", "normal/mae") == "†‡"
    assert marks(made, "ours", "nvs/psnr") == marks(made, "no-rad", "nvs/psnr") == ""
    assert footnotes(made) == [f"† {LEVEL}", f"‡ {CONSTANT}"]
    assert remarks(made) == [REMARK]
    assert texts_of(made, "no-rad", "normal/mae") == f"{LEVEL} {CONSTANT}"


def test_the_fifth_footnote_has_a_mark_of_its_own() -> None:
    made = summary()
    made["doubts"] = [{"column": "nvs/psnr", "rows": ["ours"], "text": str(place)} for place in range(6)]
    assert [each.split()[0] for each in footnotes(made)] == ["†", "‡", "§", "¶", "††", "‡‡"]


def test_every_form_marks_values_and_gives_the_reason_below() -> None:
    made = doubted()
    (table,) = parts_of(suite_table(made), 160)
    assert [str(cell).splitlines()[0] for cell in table.columns[2].cells] == ["7.50†", "7.00†"]
    text = suite_markdown(suite_table(made), "")
    assert "| 7.50† |" in text
    assert "| 7.00†‡ (-0.50, -1.00 to 0.00) |" in text
    assert text.endswith(f"\n\n† {LEVEL}\n\n‡ {CONSTANT}\n\n{REMARK}\n")
    text = suite_latex(suite_table(made))
    assert r"7.50 & $^\dagger$ &" in text
    assert r"7.00 & $^\dagger$$^\ddagger$ &" in text
    assert rf"\par $^\dagger$ {LEVEL}" in text
    assert r"\par $^\ddagger$ no better than a constant \& more" in text
    assert text.index(r"\end{tabular}") < text.index(r"\end{table}") < text.index(LEVEL)
    records = pd.read_csv(io.StringIO(suite_csv(made))).set_index(["row", "column"])["doubt"]
    assert records["no-rad", "normal/mae"] == f"{LEVEL} {CONSTANT}"
    assert pd.isna(records["ours", "nvs/psnr"])
    text = page(made, Album())
    assert f'<p class="hint">† {LEVEL}</p>' in text
    assert f'<p class="hint">‡ {CONSTANT.replace("&", "&amp;")}</p>' in text
    cells = [row.cells[1] for row in suite_table(made).rows]
    assert [(cell.text, cell.marks, cell.value) for cell in cells] == [("7.50", "†", 7.5), ("7.00", "†‡", 7.0)]


def test_a_summary_without_doubts_has_no_marks() -> None:
    assert "†" not in suite_markdown(suite_table(summary()), "")
    assert "dagger" not in suite_latex(suite_table(summary()))
