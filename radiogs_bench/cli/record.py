"""``radiogs-bench record`` and ``publish``: keep the results of finished runs, and make a site of them."""

from pathlib import Path

from radiogs_core.errors import UsageError

from .options import Names
from .reporter import say


def record(*out: Path, to: Path, markdown: Path | None = None, document: Path | None = None) -> None:
    """Keep the tables of finished runs in a sealed file, which is shown beside shorter runs.

    Example:  radiogs-bench record out/ablations --to radiogs_bench/records/ablations.json

    :param out: Record the runs in these folders (default: none; the record in the file of --to stays as it is).
    :param to: Write the record to this file; radiogs_bench/records/SUITE.json is shown beside every run of SUITE.
    :param markdown: Write the means of its runs as a page to this file.
    :param document: Write the whole record to this file: tables with intervals, analyses, and differences by scene.
    """
    from radiogs_reports.wording import count_of
    from radiogs_reports.write.record import record_document, record_page

    from ..results.records import read_record, record_of, write_record
    from ..runs.sweep import read_sweep
    from ..store.atomic import write_atomically
    from ..store.folder import Store

    texts = ((markdown, record_page), (document, record_document))
    if not out and all(path is None for path, _ in texts):
        raise UsageError(
            "neither a run nor a document was named", "", "Name the folders of finished runs, or --markdown FILE."
        )
    if out:
        write_record(to, [record_of(Store(folder), read_sweep(folder)) for folder in out])
        say(f"{to}: record of {count_of(len(out), 'run')}")
    for path, text in texts:
        if path is not None:
            write_atomically(path, text(read_record(to)).encode())
            say(f"{path}: the record in {to}")


def publish(*out: Path, to: Path, with_pictures_of: Names = ()) -> None:
    """Make a static site of runs: a table over all, a page of each row and scene, model cards, checksums.

    Pictures of a scene are shown if it comes with the package, or by a licence such as CC0 or CC BY in its metadata.
    Publish into the same folder again to renew the site.

    Example:  radiogs-bench publish out/ablations --to site

    :param out: Publish the runs in these folders, and sealed records (JSON files).
    :param to: Write the site to this folder: a new one, an empty one, or an earlier site's.
    :param with_pictures_of: Show pictures of these scenes, too, whatever their licence: you have the right to.
    """
    from radiogs_reports.wording import count_of

    from ..results.site import publish as write

    if not out:
        raise UsageError("no run was named", "", "Name its folder:  radiogs-bench publish OUT --to SITE")
    lines = write(out, to, with_pictures_of)
    for missing in (each for line in lines for each in line["missing"]):
        say(f"missing: {missing}")
    pages = count_of(sum(bool(line["page"]) for line in lines), "page")
    say(f"{to / 'index.html'}: {count_of(len(lines), 'line')}, {pages} of rows and scenes")
