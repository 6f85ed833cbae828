"""Tables and figures, made from stored results alone."""

from pathlib import Path

from .contact_sheet import write_contact_sheet
from .latex import document, table
from .page import write_page
from .plain import csv, markdown
from .summary import read_summary

__all__ = ["write_reports"]


def write_reports(out: Path) -> list[Path]:
    """Write every table and figure of the run in ``out`` from its summary.json and arrays; returns the files.

    The same stored results give the same bytes.
    """
    summary = read_summary(out)
    texts = {
        f"{summary['suite']}_table.tex": table(summary),
        f"{summary['suite']}.tex": document(summary),
        f"{summary['suite']}.md": markdown(summary),
        f"{summary['suite']}.csv": csv(summary),
    }
    written = []
    for name, text in texts.items():
        (out / name).write_text(text, encoding="utf-8")
        written.append(out / name)
    if summary["sheet"]:
        written.append(write_contact_sheet(summary, out))
    written.append(write_page(summary, out))
    return written
