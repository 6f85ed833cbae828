"""Reports from a made-up summary: complete, escaped, ranked, repeatable; the LaTeX compiles where LaTeX is."""

import csv as csv_reader
import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from compiled import pdflatex
from made_up_run import summary, write_run
from radiogs_reports.figures.contact_sheet import write_bands, write_contact_sheet
from radiogs_reports.run_folder import texts, write_reports
from radiogs_reports.summary import Summary, read_summary
from radiogs_reports.tables.caption import run_note
from radiogs_reports.tables.suite import suite_table
from radiogs_reports.write.camera_ready import camera_ready
from radiogs_reports.write.latex import END, PREAMBLE, document, escape, report_document
from radiogs_reports.write.suite import suite_csv, suite_latex, suite_markdown


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with all reports; they take seconds to make."""
    folder = write_run(tmp_path_factory.mktemp("run"), summary())
    write_reports(folder)
    return folder


def test_reports_are_rebuilt_byte_for_byte(run: Path, tmp_path: Path) -> None:
    first = {path.name: path.read_bytes() for path in write_reports(write_run(tmp_path, summary()))}
    assert {name: next(run.rglob(name)).read_bytes() for name in first} == first
    assert {name for name in first if not name.endswith((".png", ".pdf"))} | {"contact_sheet.png"} == {
        "ablations.tex", "ablations_table.tex", "ablations.md", "ablations.csv", "contact_sheet.png", "report.html",
        "report.tex", "strategies.tex", "strategies.md", "strategies.csv",
    }  # fmt: skip


def test_rows_without_a_reference_row_have_all_reports(tmp_path: Path) -> None:
    made = summary()
    made["reference"] = None
    for row in made["cells"].values():
        for cell in row.values():
            cell["difference"] = None
    written = {path.name for path in write_reports(write_run(tmp_path, made))}
    assert {"ablations.tex", "report.html", "report.tex"} <= written


def test_the_legend_names_units_resolved_differences_and_the_smallest_one() -> None:
    intervals, resolved, power = suite_table(summary()).legend
    assert intervals.endswith("t intervals over 2 seeds of my_scene, and of that scene alone.")
    assert "at most 5 % of columns would have a false difference, and at most 10 % of tables of 2 columns" in resolved
    assert power.endswith("(2 seeds): NVS PSNR 1.75 dB, Normal MAE 0.40 degrees.")
    for text in (suite_latex(suite_table(summary())), suite_markdown(suite_table(summary()), "")):
        assert "at most 10" in text
        assert "1.75 dB" in text


@pytest.mark.parametrize("row", ["ours", "no-rad"])
def test_a_value_that_a_footnote_concerns_has_no_colour(row: str) -> None:
    made = summary()
    made["doubts"] = [{"column": "nvs/psnr", "rows": [row], "text": "no better than a constant"}]
    assert "FBDCC4}30.00" not in suite_latex(suite_table(made))
    assert "CDE4F7}7.00" in suite_latex(suite_table(made))
    assert ": worse)" not in run_note(made)
    psnr, normals = suite_table(made).rows[1].cells[:2]
    assert (psnr.verdict, normals.verdict) == (None, "better")


def test_one_scene_and_seed_resolves_nothing_and_says_so() -> None:
    made = summary()
    for row in made["cells"].values():
        for cell in row.values():
            if cell["difference"] is not None:
                cell["difference"].update(low=None, high=None, p_value=None, verdict=None, units=1)
    (sentence,) = suite_table(made).legend
    assert sentence.startswith("One scene with one seed")


def test_the_table_says_everything_that_the_summary_says() -> None:
    text = suite_latex(suite_table(summary()))
    assert r" & 31.23 & \textcolor{gray}{(37.86)} &" in text
    assert r"\cellcolor[HTML]{FBDCC4}30.00" in text
    assert r"\cellcolor[HTML]{CDE4F7}7.00" in text
    assert r"\scriptsize -1.23 & \scriptsize $\pm$0.50 &" in text
    body = text[text.index(r"\toprule") :]
    assert body.index(r"\addlinespace") < body.index(r"\lambda_{rad}=0") < body.index("-1.23")
    assert "n/a$^{a}$" in text
    assert r"$^{a}$ no\_weights" in text
    assert r"my\_scene" in text
    assert r"Ablation \& more" in text
    assert "abc, def" in text
    below = text.split(r"\midrule")[1]
    assert {line.count("&") for line in below.splitlines() if line.endswith(r"\\")} == {8}
    assert text.count("{") == text.count("}")


def test_markdown_and_csv_hold_the_same_values() -> None:
    text = suite_markdown(suite_table(summary()), "")
    assert "| Ours | 31.23 | 7.50 | n/a (no_weights) | 61.2 | 37.86 |" in text
    records = list(csv_reader.DictReader(io.StringIO(suite_csv(summary()))))
    assert len(records) == 6
    found = next(record for record in records if record["row"] == "no-rad" and record["column"] == "nvs/psnr")
    assert float(found["difference_low"]) == pytest.approx(-1.734)
    assert found["published"] == "35.82"


def test_the_contact_sheet_is_large_enough_to_judge(run: Path) -> None:
    with Image.open(run / "contact_sheet.png") as sheet:
        assert sheet.width > 7 * 160
        assert sheet.height > 2 * 160


def height_of_contact_sheet(folder: Path, made: Summary) -> int:
    with Image.open(write_contact_sheet(made, folder)) as sheet:
        return sheet.height


def test_the_contact_sheet_shows_the_same_truth_once(tmp_path: Path) -> None:
    one, two, other = (summary() for _ in range(3))
    for made in (two, other):
        made["sheet"].append({**made["sheet"][0], "row": "no-rad", "arrays": "cells/def.npz"})
    folder = write_run(tmp_path, one)
    alone, both = (height_of_contact_sheet(folder, made) for made in (one, two))
    assert 1.3 * alone < both < 1.7 * alone, "a title and a line more"
    path = folder / "cells" / "def.npz"
    with np.load(path) as stored:
        arrays = dict(stored)
    np.savez(path, **(arrays | {"truth/normal": -arrays["truth/normal"]}))
    assert height_of_contact_sheet(folder, other) == 2 * alone


def test_the_contact_sheet_of_photos_is_one_line_of_reduced_maps(tmp_path: Path) -> None:
    found = {name: np.full((600, 1300, 3), 0.5) for name in ("truth/image", "render/image", "render/albedo")}
    with Image.open(write_bands(tmp_path, [("photos", found, "")])) as sheet:
        assert sheet.size == (28 + 4 * (434 + 6), 48 + 26 + 200 + 6), "truth, image, error, albedo: a third of the side"


def test_a_row_without_a_label_in_latex_has_its_text_escaped() -> None:
    made = summary()
    made["rows"][0]["latex"], made["rows"][0]["text"] = "", "50 % of λ"
    assert r"50 \% of $\lambda$ & " in suite_latex(suite_table(made))
    assert r"paired difference to 50 \% of $\lambda$ and" in suite_latex(suite_table(made))


def test_another_schema_is_refused(tmp_path: Path) -> None:
    (tmp_path / "summary.json").write_text(json.dumps({**summary(), "schema": "radiogs-bench/summary/0"}))
    with pytest.raises(ValueError, match="summary/0"):
        read_summary(tmp_path)


def test_every_document_of_a_run_compiles(run: Path) -> None:
    for path in sorted(run.rglob("*.tex")):
        text = path.read_text()
        (run / "compiled.tex").write_text(text if text.startswith(PREAMBLE) else f"{PREAMBLE}{text}{END}")
        assert not re.search(r"Undefined control sequence|Overfull \\hbox", pdflatex("compiled.tex", run)), path
    (run / "compiled.tex").unlink()


def test_a_report_with_many_figures_compiles(tmp_path: Path) -> None:
    """LaTeX stopped at 82 figures: "Output loop---100 consecutive dead cycles"."""
    Image.new("RGB", (40, 30)).save(tmp_path / "view.png")
    (tmp_path / "report.tex").write_text(report_document(summary(), [], [("view.png", "A view")] * 450))
    assert "Output written on report.pdf (225 pages" in pdflatex("report.tex", tmp_path)


def test_the_table_of_a_paper_has_means_alone_with_the_best_in_bold_and_what_is_worse_in_italics() -> None:
    made = summary()
    made["rows"][1]["text"] = "λ_rad = 0"
    text = camera_ready(made)
    assert r"\multicolumn{1}{c}{NVS} & \multicolumn{1}{c}{Normal} & \multicolumn{1}{c}{}" in text
    assert r"PSNR $\uparrow$ & MAE (degrees) $\downarrow$ & Training (s) $\downarrow$" in text
    assert r"Ours & \textbf{31.23} & \textit{7.50} & 61.2 \\" in text
    assert r"$\lambda_\mathrm{rad}$ = 0 & \textit{30.00} & \textbf{7.00} & \textbf{40.0} \\" in text
    assert text.split(r"\caption{")[1].index("\n") < 2 * 80, "two lines"
    assert (
        text.index(r"\end{tabular}")
        < text.index(r"\raggedright")
        < text.index("Scenes: ")
        < text.index(". PSNR in dB.")
    )
    assert text.count(r"\cmidrule") == 2, "none over the seconds, which are of no quantity"
    for absent in ("1.234", "cellcolor", "radiogs-bench", "n/a", "LPIPS"):
        assert absent not in text
    assert "PSNR in dB" not in camera_ready(made, ["normal/mae"])
    both = camera_ready(made, ["nvs/lpips", "nvs/psnr"])
    assert r"\multicolumn{2}{c}{NVS} \\" in both
    assert r"Ours & -- & \textbf{31.23} \\" in both


@pytest.mark.parametrize(
    ("recipe", "division"),
    [("printed, closed at tiny", "closed"), ("printed, shortened (600 steps, rates x 12)", "open"),
     ("recommended", "open"), ("printed", "closed")],
)  # fmt: skip
def test_every_table_names_the_division_of_its_recipe(recipe: str, division: str) -> None:
    made = {**summary(), "recipe": recipe}
    for text in (camera_ready(made), run_note(made)):
        assert f"{recipe} ({division} division)" in text


def test_the_table_of_a_paper_compiles(tmp_path: Path) -> None:
    (tmp_path / "paper.tex").write_text(document(camera_ready(summary())))
    assert not re.search(r"Undefined control sequence|Overfull \\hbox", pdflatex("paper.tex", tmp_path))


def test_a_worse_mean_is_never_printed_bolder_than_a_better_one_whatever_ranks_are_stored() -> None:
    made = summary()
    made["cells"]["ours"]["nvs/psnr"]["rank"], made["cells"]["no-rad"]["nvs/psnr"]["rank"] = 2, 1
    text = camera_ready(made, ["nvs/psnr"])
    assert r"Ours & \textbf{31.23} \\" in text
    assert r"& \textit{30.00} \\" in text


def test_means_that_print_alike_are_bold_together() -> None:
    made = summary()
    made["cells"]["no-rad"]["nvs/psnr"]["mean"] = 31.2341
    assert camera_ready(made, ["nvs/psnr"]).count(r"\textbf{31.23}") == 2


def test_counts_have_no_value_in_bold() -> None:
    made = summary()
    made["columns"][0]["direction"] = "none"
    for row in made["cells"].values():
        row["nvs/psnr"]["rank"] = None
    text = camera_ready(made, ["nvs/psnr"])
    assert "Ours & 31.23 " in text
    assert r"\textbf" not in text


def test_a_value_that_a_footnote_concerns_keeps_it_in_the_table_of_a_paper() -> None:
    made = summary()
    made["doubts"] = [{"column": "nvs/psnr", "rows": ["ours"], "text": "no better than a constant"}]
    (note,) = suite_table(made).footnotes
    assert escape(note) in camera_ready(made)
    assert escape(note) not in camera_ready(made, ["normal/mae"])


@pytest.mark.parametrize("text", ["[2] ours", "* ours"])
def test_a_row_may_begin_with_a_bracket_or_a_star(text: str, tmp_path: Path) -> None:
    made: Any = summary()
    for row in (*made["rows"], *made["paper"][0]["rows"]):
        row["text"], row["latex"] = text, ""
    for name, content in (texts(made) | {"paper.tex": document(camera_ready(made))}).items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(content)
    pdflatex("report.tex", tmp_path)
    pdflatex("paper.tex", tmp_path)
    assert f"{{}}{text} &" in (tmp_path / "paper.tex").read_text()


def test_the_document_compiles_whatever_rows_are_called(tmp_path: Path) -> None:
    made = summary()
    for row, text in zip(made["rows"], ("한국어 50 % β_1 & {~^\\}", "Größe ≤ 3 … №7 → Ł"), strict=True):
        row["latex"], row["text"] = "", text
    for row, text in zip(made["paper"][0]["rows"], ("日本, λ_rad = 0", "é#$", "N_g^PBR²"), strict=True):
        row["text"] = text
    for name, text in texts(made).items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    said = pdflatex("report.tex", tmp_path)
    assert "Output written on report.pdf (2 pages" in said  # tables, then their findings as text
    assert "Missing character" not in said
