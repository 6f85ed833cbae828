"""The paper's tables: the same rows and columns, nothing blank, LaTeX that holds together, values that agree."""

import csv
import io
import re

from made_up_run import paper_table, summary
from radiogs_reports.page.tables import paper_tables
from radiogs_reports.run_folder import texts
from radiogs_reports.summary import PaperTable
from radiogs_reports.tables.caption import run_note
from radiogs_reports.tables.paper import paper_table as made_table
from radiogs_reports.tables.suite import suite_table
from radiogs_reports.write.latex import as_formula, escape
from radiogs_reports.write.paper import paper_csv, paper_latex, paper_markdown
from radiogs_reports.write.suite import suite_latex, suite_markdown

TABLE, SUMMARY = paper_table(), summary()
LATEX = paper_latex(made_table(TABLE, SUMMARY))


def spanned(line: str) -> int:
    """How many columns a line of a tabular fills."""
    cells = re.split(r"(?<!\\)&", line)
    return sum(int(span[1]) if (span := re.match(r"\s*\\multicolumn\{(\d+)\}", cell)) else 1 for cell in cells)


def assert_holds_together(text: str) -> None:
    """Environments and braces are balanced, every line of every tabular fills its columns, nothing special is bare."""
    bare = re.sub(r"(?m)(?<!\\)%.*$", "", text)
    open_environments: list[str] = []
    for kind, name in re.findall(r"\\(begin|end)\{(\w+\*?)\}", bare):
        if kind == "begin":
            open_environments.append(name)
        else:
            assert open_environments.pop() == name
    assert open_environments == []
    depth = 0
    for brace in re.findall(r"(?<!\\)[{}]", bare):
        depth += 1 if brace == "{" else -1
        assert depth >= 0
    assert depth == 0
    assert len(re.findall(r"(?<!\\)\$", bare)) % 2 == 0
    outside = re.sub(r"(?<!\\)\$.*?(?<!\\)\$", "", bare, flags=re.S)
    outside = re.sub(r"\\(label|input|includegraphics)(\[[^]]*\])?\{[^}]*\}", "", outside)
    assert not re.search(r"(?<!\\)[_^~#]", re.sub(r"~\\(textcolor|ref)", "", outside))
    assert outside.isascii()
    for layout, body in re.findall(r"\\begin\{tabular\}\{([^\n]*)\}\n(.*?)\\end\{tabular\}", bare, flags=re.S):
        lines = [line for line in body.splitlines() if line.rstrip().endswith(r"\\")]
        assert lines
        assert {spanned(line) for line in lines} == {len(re.sub(r"\[.*?\]|@\{.*?\}", "", layout))}


def cells_of(text: str) -> list[list[str]]:
    """The cells of the table's lines below its heading."""
    body = text.split(r"\midrule")[1].split(r"\bottomrule")[0]
    return [
        [cell.strip() for cell in re.split(r"(?<!\\)&", line.rstrip().removesuffix(r"\\"))]
        for line in body.splitlines()
        if line.endswith(r"\\")
    ]


def test_every_text_of_a_run_in_latex_holds_together() -> None:
    made = {name: text for name, text in texts(SUMMARY).items() if name.endswith(".tex")}
    assert made.keys() == {"ablations.tex", "ablations_table.tex", "report.tex", "tables/strategies.tex"}
    for text in made.values():
        assert_holds_together(text)


def test_rows_and_columns_are_the_papers_and_no_cell_is_blank() -> None:
    lines = cells_of(LATEX)
    assert [line[0] for line in lines if line[0]] == [as_formula(row["text"]) for row in TABLE["rows"]]
    for line in lines:
        if "difference" not in line[1]:
            assert all(line[2::2]), line
    assert r"\multicolumn{4}{c}{NVS}" in LATEX
    heads = re.findall(r"\\multicolumn\{2\}\{c\}\{(.*?)\}(?= &| \\\\)", LATEX.split("Method")[1].split(r"\midrule")[0])
    assert heads == [r"PSNR $\uparrow$", r"LPIPS $\downarrow$", r"h $\downarrow$", "N (rays)"]


def test_methods_that_the_paper_prints_side_by_side_stand_side_by_side() -> None:
    table = paper_table()
    table["key"] = "views"
    values = table["cells"].pop("detach")
    keys = ("ours-100", "no-rad-100", "ours-50", "no-rad-50")
    table["rows"] = [
        {"key": key, "text": f"{method}, {key.rpartition('-')[2]} % of the views", "remark": ""}
        for key, method in zip(keys, ("Ours", "Ours w/o L_rad") * 2, strict=True)
    ]
    table["cells"] = {key: {name: {**each} for name, each in values.items()} for key in keys}
    table["cells"]["no-rad-50"]["nvs/psnr"].update(mean=12.345, published="-0.54")
    table["reference"] = "ours-100"
    text = paper_latex(made_table(table, SUMMARY))
    assert_holds_together(text)
    lines = cells_of(text)
    assert [line[0] for line in lines if line[0]] == [r"100 \% of the views", r"50 \% of the views"]
    # Half of the two methods' numbers in every column are in the first part of the table.
    assert {len(line) for line in lines} == {2 + 2 * len(table["columns"])}
    assert text.count(r"Ours w/o $L_\mathrm{rad}$ $\uparrow$") == 1
    measured_line = next(line for line in lines if line[0].startswith("50"))
    assert "30.123" in measured_line[2]
    assert "12.345" in measured_line[4]
    assert "paired difference to Ours, 100" in text
    assert r"\color{darkgray}-0.54" in text
    assert "| 50 % of the views | measured | 30.123" in paper_markdown(made_table(table, SUMMARY))


def test_every_missing_value_has_its_reason_below_the_table() -> None:
    marks = set(re.findall(r"n/a\$\^\{(\w+)\}\$", LATEX))
    assert marks == {"a", "b"}
    assert r"$^{a}$ not in this store; 100 \% lost \& gone." in LATEX
    assert r"$^{b}$ The paper prints a dash." in LATEX
    assert r"paper}$^{c}$" in LATEX
    assert "$^{c}$ Printed otherwise in table 3." in LATEX


def test_a_resolved_difference_has_a_colour_and_published_values_have_none() -> None:
    assert r"\cellcolor[HTML]{FBDCC4}30.123" in LATEX
    assert LATEX.count(r"\cellcolor") == 1
    assert "smallest true difference of a typical row" in LATEX
    assert [cell.verdict for cell in paper_tables(TABLE, SUMMARY)[0].rows[1].cells] == ["worse", None, None, None]


def test_a_small_value_is_not_printed_as_zero() -> None:
    hours = [row.cells[2].text for row in made_table(TABLE, SUMMARY).rows]
    assert hours == ["n/a", "0.00047", "2.0"]


def test_the_caption_names_seeds_interval_and_source_of_published_values() -> None:
    text = made_table(TABLE, SUMMARY).caption
    for part in ("2 seeds (0, 1)", "1 scene (my_scene)", "95 % t interval", "TensoIR_Ind", "Ours_100 %"):
        assert part in text


def test_markdown_and_csv_hold_the_values_of_the_latex() -> None:
    text = paper_markdown(made_table(TABLE, SUMMARY))
    assert (
        "| Detach L_G^PBR | measured | 30.123 (-1.500 ± 0.500: worse) | 0.2500 (0.0000 ± 0.5000) | 0.00047 | 64 |"
        in text
    )
    assert "|  | paper [3] | 37.252 | 0.0275 | 1.1 | 64 |" in text
    assert "1. not in this store; 100 % lost & gone" in text
    records = list(csv.DictReader(io.StringIO(paper_csv(TABLE, SUMMARY))))
    assert len(records) == 12
    for record in records:
        value = TABLE["cells"][record["row"]][record["column"]]
        assert record["published"] == (value["published"] or "")
        assert (float(record["mean"]) if record["mean"] else None) == value["mean"]
        assert bool(record["mean"]) != bool(record["not_measured"])


def test_symbols_with_an_index_are_set_as_formulas_and_names_are_not() -> None:
    assert as_formula("λ_rad = 0") == r"$\lambda_\mathrm{rad}$ = 0"
    assert as_formula("Detach L_G^PBR & N_g") == r"Detach $L_\mathrm{G}^\mathrm{PBR}$ \& $N_\mathrm{g}$"
    assert as_formula("TensoIR_Ind") == r"TensoIR\_Ind"


def test_every_character_becomes_something_that_pdflatex_prints() -> None:
    assert escape("±\u2212…") == r"$\pm$$-$\dots{}"
    assert escape("Ωλ") == r"$\Omega$$\lambda$"
    assert escape("한") == r"\texttt{U+D55C}"
    assert escape("ß") == "ß"
    assert escape(r"a_b & 5% \ {x}^~") == r"a\_b \& 5\% \textbackslash{} \{x\}\textasciicircum{}\textasciitilde{}"
    assert "\n" not in escape("a\nb")


def other_conditions(*apart: str) -> PaperTable:
    """The table after a run on another scene, whose protocol computes the columns ``apart`` otherwise."""
    table = paper_table()
    table["rows"][1]["ran"] = RAN
    for column in table["columns"]:
        if column["key"] in apart:
            column["published_by"] = "radiogs"
    return table


IMAGES = ("nvs/psnr", "nvs/lpips")


RAN = "Detach L_G^PBR: preset tiny; corner; 96 x 96; CPU"


def test_published_values_by_other_conventions_stand_apart() -> None:
    stored = other_conditions(*IMAGES)
    table = made_table(stored, SUMMARY)
    upper, lower = paper_markdown(table).split("Published, by protocol radiogs;")
    assert f"| {RAN} | measured | 30.123" in upper
    assert "| Detach L_G^PBR | paper [3] |  |  | 1.1 | 64 |" in upper
    assert "37.252" not in upper
    assert "| Detach L_G^PBR [3] | 37.252 | 0.0275 |" in lower
    assert_holds_together(paper_latex(table))
    upper, lower = paper_latex(table).split("Published, by protocol radiogs")
    assert "37.252" not in upper
    assert "30.123" in upper
    assert "37.252" in lower
    assert "preset tiny; corner; 96 x 96; CPU" in upper
    measured, published = paper_tables(stored, SUMMARY)
    assert measured.rows[1].measured_label == RAN
    assert [cell.published and cell.published.text for cell in measured.rows[1].cells] == [None, None, "1.1", "64"]
    assert published.rows[1].text == "Detach L_G^PBR"
    assert [cell.text for cell in published.rows[1].cells] == ["37.252", "0.0275"]
    assert [column.label for column in published.columns] == ["NVS PSNR", "NVS LPIPS"]
    assert len(paper_tables(TABLE, SUMMARY)) == 1


def test_records_name_the_protocol_and_the_measured_rows() -> None:
    records = list(csv.DictReader(io.StringIO(paper_csv(other_conditions(*IMAGES), SUMMARY))))
    found = {(each["row"], each["column"]): (each["published_by"], each["ran"]) for each in records}
    assert found["detach", "nvs/psnr"] == ("radiogs", RAN)
    assert found["ours", "training/hours"] == ("", "")


def test_the_suites_table_leaves_out_values_by_other_conventions() -> None:
    made = summary()
    column = made["columns"][0]
    assert "(37.86)" in suite_latex(suite_table(made))
    column["published_by"] = "radiogs"
    assert "(37.86)" not in suite_latex(suite_table(made))
    text = suite_markdown(suite_table(made), run_note(made))
    assert f"paper: {column['label']}" not in text
    assert "By protocol radiogs, whose conventions are others" in text
    assert all(row.cells[0].published is None for row in suite_table(made).rows)
