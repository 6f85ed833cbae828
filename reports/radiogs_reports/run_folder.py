"""Every report of a run, written into its folder."""

from collections.abc import Callable, Sequence
from pathlib import Path

from matplotlib import rc_context

from radiogs_core.own_files import fresh, require_own_folders

from .analyses import ANALYSES, reports_of
from .figures.canvas import FOLDER, STYLE, Drawn, save
from .figures.contact_sheet import write_contact_sheet
from .figures.convergence import convergence_figures
from .figures.curves import curve_figures
from .figures.finetuning import finetuning_figures
from .figures.light import environment_figures, illumination_figures, relighting_figures
from .figures.overview import overview_figures
from .figures.qualitative import qualitative_figures
from .figures.stability import stability_figure
from .made_files import begin_record, keep_record, made_from, unchanged
from .page.assemble import write_page
from .page.pictures import FOLDER as PICTURES
from .summary import Summary, read_summary
from .tables.caption import run_note
from .tables.paper import paper_table
from .tables.suite import suite_table
from .write.analyses import findings_latex, findings_markdown
from .write.csv_text import csv_of
from .write.latex import document, report_document
from .write.markdown import without_markup
from .write.paper import paper_csv, paper_latex, paper_markdown
from .write.record import below_a_run
from .write.suite import suite_csv, suite_latex, suite_markdown

PARTS = 4
"""Number of steps that ``write_reports`` reports: figures, tables, contact sheet, page."""


def write_reports(
    out: Path,
    beside: bool = False,
    advance: Callable[[int, int], object] = lambda done, total: None,
    pictures: bool = True,
) -> list[Path]:
    """Write every table and figure of the run in ``out`` from its summary.json and arrays; returns the files.

    ``beside``: the page's pictures are files in a folder, all of them and without loss. Without ``pictures`` there are
    neither figures nor images nor surfels, which take nearly all of the time.

    The same stored results give the same bytes; reports that are there and would be the same are not made again. Tables
    and figures that only an earlier run had are deleted. ``advance`` receives how many of the ``PARTS`` are done.
    Raises ValueError for an unusable summary, UsageError if a folder of reports is a link, OSError if they cannot be
    written.
    """
    summary = read_summary(out)
    require_own_folders(out, "tables", FOLDER, PICTURES)
    source = made_from(summary, out, beside, pictures)
    there = unchanged(out, source)
    if there is not None:
        return there
    begin_record(out, summary["suite"])
    advance(0, PARTS)
    figures = write_figures(summary, out) if pictures else []
    advance(1, PARTS)
    written = []
    for name, text in texts(summary, figures).items():
        written.append(fresh(out / name, out))
        written[-1].write_text(text, encoding="utf-8", errors="backslashreplace")
    advance(2, PARTS)
    if summary["sheet"] and pictures:
        written.append(write_contact_sheet(summary, out))
    advance(3, PARTS)
    written += write_page(summary, out, [drawn for drawn in figures if drawn.on_page], beside, pictures)
    written += [path for drawn in figures for path in (drawn.png, drawn.pdf)]
    keep_record(out, written, source)
    advance(PARTS, PARTS)
    return written


def write_figures(summary: Summary, out: Path) -> list[Drawn]:
    """Write every figure that the stored results allow into ``out``/figures; the same results give the same bytes."""
    with rc_context(STYLE):
        figures = [
            *(sketch for analysis in ANALYSES for sketch in analysis.figures(summary)),
            *curve_figures(summary),
            *convergence_figures(summary),
            *finetuning_figures(summary, out),
            *overview_figures(summary, out),
            *qualitative_figures(summary, out),
            *illumination_figures(summary, out),
            *environment_figures(summary, out),
            *relighting_figures(summary, out),
            *stability_figure(summary, out),
        ]
        return [save(figure, out) for figure in figures]


def texts(summary: Summary, figures: Sequence[Drawn] = ()) -> dict[str, str]:
    """Every text report by file name; the LaTeX document of the whole run includes ``figures``."""
    suite, table = summary["suite"], suite_table(summary)
    own = {
        f"{suite}_table.tex": suite_latex(table),
        f"{suite}.tex": document(suite_latex(table)),
        f"{suite}.md": suite_markdown(table, run_note(summary)) + below_a_run(summary),
        f"{suite}.csv": suite_csv(summary),
    }
    tables = _tables(summary)
    inputs = [f"{suite}_table.tex", *(name for name in tables if name.endswith(".tex"))]
    included = [(f"{FOLDER}/{drawn.pdf.name}", drawn.caption) for drawn in figures]
    made = own | tables | {"report.tex": report_document(summary, inputs, included)}
    return {name: without_markup(text) if name.endswith(".md") else text for name, text in made.items()}


def _tables(summary: Summary) -> dict[str, str]:
    """Tables of the paper and of every analysis that the run allows, by file name."""
    made = {}
    for stored in summary["paper"]:
        name, table = f"tables/{stored['key']}", paper_table(stored, summary)
        made[f"{name}.tex"] = paper_latex(table)
        made[f"{name}.md"] = paper_markdown(table)
        made[f"{name}.csv"] = paper_csv(stored, summary)
    for analysis, report in reports_of(summary):
        name = f"tables/{analysis.key}"
        made[f"{name}.tex"] = findings_latex(summary, analysis.title, report)
        made[f"{name}.md"] = findings_markdown(summary, analysis.title, report)
        made[f"{name}.csv"] = csv_of(report.records)
    return made
