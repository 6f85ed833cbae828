"""Writes a store's summary and reports, and prints its table."""

from functools import partial
from pathlib import Path

from radiogs_baselines.published import published
from radiogs_reports.doubts import footnotes, remarks
from radiogs_reports.run_folder import write_reports
from radiogs_reports.summary import Summary
from radiogs_reports.wording import count_of
from radiogs_reports.write.caption import published_note

from ..results.summary import summarise
from ..runs.progress import progress_for_stderr
from ..runs.sweep import Sweep
from ..store.atomic import explained, write_atomically
from ..store.folder import Store
from ..store.seal import sealed, strict_json
from .aside import say_aside
from .fitting import tables_of
from .reporter import console, say, show

PAGE = "report.html"


def write_and_show(store: Store, sweep: Sweep, alone: bool = False) -> None:
    """Rebuild the summary and the reports of a run, print the table; the last line says what to open.

    ``alone``: as in ``write``.
    """
    summary, written = write(store, sweep, alone)
    for table in tables_of(summary, console().width):
        show(table)
    say(explanation(summary))
    for sentence in (*reasons(summary), *footnotes(summary)):
        say(sentence)
    say_remarks(summary)
    say(f"Metric protocol: {summary['protocol']}. {published_note(summary)}")
    say_aside(store)
    say(f"{len(written)} files in {store.folder}; open {store.folder / PAGE}")


def say_remarks(summary: Summary) -> None:
    """How many remarks there are: they fill a screen, and the page has them."""
    count = len(remarks(summary))
    if count:
        say(f"The page has {count_of(count, 'remark')} more, on what differs from the published and what is not known.")


def write(store: Store, sweep: Sweep, alone: bool = False) -> tuple[Summary, list[Path]]:
    """Rebuild the summary and the reports of a run, given by its manifest; returns the summary and all files.

    ``alone``: the page has to be a single file.
    """
    table = published(sweep["published"]) if sweep["published"] else None
    summary = summarise(store, sweep, table.figures if table else {}, table.data if table else "none for this suite")
    with store.patient_claim("summary"), progress_for_stderr() as progress:
        write_atomically(store.folder / "summary.json", strict_json(sealed(summary)))
        with explained(store.folder):
            written = write_reports(store.folder, alone, partial(progress.advance, "figures, tables, page"))
    return summary, [store.folder / "summary.json", *written]


def explanation(summary: Summary) -> str:
    """A sentence that explains what is below each value in the table."""
    if summary["reference"] is None:
        return "The rows are not variants of one method, so no differences are shown."
    pairs = max(cell["count"] for row in summary["cells"].values() for cell in row.values())
    below = f"Below each value: its difference to '{summary['reference']}'"
    if pairs <= 1:
        return f"{below}; a single run has no interval (use --seeds 2 or more)."
    return f"{below}, paired over {pairs} (scene, seed), with its 95 % t interval."


def reasons(summary: Summary) -> list[str]:
    """Why values are missing: each reason once, with its columns."""
    columns: dict[str, list[str]] = {}
    for column in summary["columns"]:
        for row in summary["rows"]:
            reason = summary["cells"][row["key"]][column["key"]]["reason"]
            if reason is not None and column["label"] not in columns.setdefault(reason, []):
                columns[reason].append(column["label"])
    return [f"missing in {', '.join(labels)}: {reason}" for reason, labels in columns.items()]
