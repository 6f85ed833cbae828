"""Two runs into one folder: only the second's tables and figures remain, and nothing else is deleted."""

from pathlib import Path

from radiogs_reports.stale import drop_stale


def files(folder: Path, *names: str) -> list[Path]:
    for name in names:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(name)
    return [folder / name for name in names]


def there(folder: Path) -> set[str]:
    found = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    return found - {"reports.txt"}


def test_only_what_an_earlier_run_alone_had_is_deleted(tmp_path: Path) -> None:
    files(tmp_path, "tables/mine.md", "figures/notes.png", "cells/a.json")
    first = ["a.tex", "report.html", "tables/audit.md", "tables/cost.md", "figures/audit.png", "contact_sheet.png"]
    drop_stale(tmp_path, files(tmp_path, *first))
    assert there(tmp_path) == {*first, "tables/mine.md", "figures/notes.png", "cells/a.json"}
    second = ["b.tex", "report.html", "tables/cost.md"]
    drop_stale(tmp_path, files(tmp_path, *second))
    assert there(tmp_path) == {"a.tex", *second, "tables/mine.md", "figures/notes.png", "cells/a.json"}


def test_a_table_that_a_user_put_where_one_was_deleted_stays(tmp_path: Path) -> None:
    drop_stale(tmp_path, files(tmp_path, "tables/audit.md"))
    drop_stale(tmp_path, files(tmp_path, "tables/cost.md"))
    files(tmp_path, "tables/audit.md")
    drop_stale(tmp_path, files(tmp_path, "tables/cost.md"))
    assert there(tmp_path) == {"tables/audit.md", "tables/cost.md"}
