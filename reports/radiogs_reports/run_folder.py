"""Tables and figures, made from stored results alone."""

from collections.abc import Sequence
from pathlib import Path

from .analysis.audit import audit_report
from .analysis.cost import cost_report
from .figures import Drawn, write_figures
from .figures.canvas import FOLDER
from .figures.contact_sheet import write_contact_sheet
from .page import write_page
from .stale import drop_leftovers
from .summary import Summary, read_summary
from .write.audit import audit_csv, audit_latex, audit_markdown
from .write.cost import cost_csv, cost_latex, cost_markdown
from .write.document import report_document
from .write.latex import document, table
from .write.paper import paper_csv, paper_latex, paper_markdown
from .write.plain import csv, markdown


def write_reports(out: Path) -> list[Path]:
    """Write every table and figure of the run in ``out`` from its summary.json and arrays; returns the files.

    The same stored results give the same bytes. Tables and figures that only an earlier run had are deleted.
    """
    summary = read_summary(out)
    figures = write_figures(summary, out)
    written = []
    for name, text in texts(summary, figures).items():
        path = out / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
        written.append(path)
    if summary["sheet"]:
        written.append(write_contact_sheet(summary, out))
    written.append(write_page(summary, out, [(drawn.png, drawn.caption) for drawn in figures if drawn.on_page]))
    written += [path for drawn in figures for path in (drawn.png, drawn.pdf)]
    drop_leftovers(out, written)
    return written


def texts(summary: Summary, figures: Sequence[Drawn] = ()) -> dict[str, str]:
    """Every report that is text, by its file's name; ``figures`` stand in the document of everything."""
    made = {
        f"{summary['suite']}_table.tex": table(summary),
        f"{summary['suite']}.tex": document(summary),
        f"{summary['suite']}.md": markdown(summary),
        f"{summary['suite']}.csv": csv(summary),
    }
    inputs = [f"{summary['suite']}_table.tex"]
    for each in summary["paper"]:
        name = f"tables/{each['key']}"
        made |= {
            f"{name}.tex": paper_latex(each, summary),
            f"{name}.md": paper_markdown(each, summary),
            f"{name}.csv": paper_csv(each),
        }
        inputs.append(f"{name}.tex")
    cost = cost_report(summary)
    if cost is not None:
        made |= {
            "tables/cost.tex": cost_latex(summary, cost),
            "tables/cost.md": cost_markdown(summary, cost),
            "tables/cost.csv": cost_csv(summary, cost),
        }
        inputs.append("tables/cost.tex")
    audit = audit_report(summary)
    if audit is not None:
        made |= {
            "tables/audit.tex": audit_latex(summary, audit),
            "tables/audit.md": audit_markdown(summary, audit),
            "tables/audit.csv": audit_csv(audit),
        }
        inputs.append("tables/audit.tex")
    shown = [(f"{FOLDER}/{drawn.pdf.name}", drawn.caption) for drawn in figures]
    return made | {"report.tex": report_document(summary, inputs, shown)}
