"""Two runs into one folder: only the second's tables and figures remain, and nothing else is deleted.

Reports that would not change are not made again.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from made_up_run import summary, write_run
from radiogs_reports import run_folder
from radiogs_reports.made_files import RECORD, keep_record
from radiogs_reports.run_folder import write_reports


def files(folder: Path, *names: str) -> list[Path]:
    for name in names:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(name)
    return [folder / name for name in names]


def there(folder: Path) -> set[str]:
    found = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    return found - {"reports.txt"}


def test_only_files_that_the_later_run_does_not_write_are_deleted(tmp_path: Path) -> None:
    files(tmp_path, "tables/mine.md", "figures/notes.png", "cells/a.json")
    first = ["a.tex", "report.html", "tables/audit.md", "tables/cost.md", "figures/audit.png", "contact_sheet.png"]
    keep_record(tmp_path, files(tmp_path, *first))
    assert there(tmp_path) == {*first, "tables/mine.md", "figures/notes.png", "cells/a.json"}
    second = ["b.tex", "report.html", "tables/cost.md"]
    keep_record(tmp_path, files(tmp_path, *second))
    assert there(tmp_path) == {"a.tex", *second, "tables/mine.md", "figures/notes.png", "cells/a.json"}


def test_a_table_that_a_user_put_where_one_was_deleted_stays(tmp_path: Path) -> None:
    keep_record(tmp_path, files(tmp_path, "tables/audit.md"))
    keep_record(tmp_path, files(tmp_path, "tables/cost.md"))
    files(tmp_path, "tables/audit.md")
    keep_record(tmp_path, files(tmp_path, "tables/cost.md"))
    assert there(tmp_path) == {"tables/audit.md", "tables/cost.md"}


@pytest.fixture(scope="module", autouse=True)
def _without_figures() -> Iterator[None]:
    """Figures take most of the time of a report; the contact sheet and the page stand for them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run_folder, "write_figures", lambda summary, out: [])
        yield


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_run(tmp_path_factory.mktemp("run"), summary())
    write_reports(folder)
    return folder


def dates(folder: Path) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}


def test_reports_that_would_not_change_are_not_made_again(made: Path) -> None:
    before = dates(made)
    again = write_reports(made)
    assert dates(made) == before
    assert {path.name for path in again} >= {"report.html", "contact_sheet.png"}


def another_summary(folder: Path) -> None:
    changed = summary()
    changed["title"] = "Another"
    write_run(folder, changed)


def another_array(folder: Path) -> None:
    arrays = next(folder.glob("cells/*.npz"))
    with np.load(arrays) as file:
        np.savez(arrays, **{name: file[name] * 0.5 for name in file})


def a_damaged_report(folder: Path) -> None:
    (folder / "report.html").write_text("damaged")


def a_deleted_report(folder: Path) -> None:
    (folder / "contact_sheet.png").unlink()


def a_link(folder: Path) -> None:
    text = (folder / "report.html").read_bytes()
    (folder / "elsewhere").write_bytes(text)
    (folder / "report.html").unlink()
    (folder / "report.html").symlink_to(folder / "elsewhere")


def a_record_of_earlier_versions(folder: Path) -> None:
    (folder / RECORD).write_text("report.html\n")


@pytest.mark.parametrize(
    "change", [another_summary, another_array, a_damaged_report, a_deleted_report, a_link, a_record_of_earlier_versions]
)
def test_all_are_made_again_after(change: Callable[[Path], None], tmp_path: Path) -> None:
    folder = write_run(tmp_path, summary())
    write_reports(folder)
    expected = (folder / "report.html").read_bytes()
    change(folder)
    before = dates(folder).get("contact_sheet.png", 0)
    write_reports(folder)
    assert dates(folder)["contact_sheet.png"] > before
    assert not (folder / "report.html").is_symlink()
    if change not in (another_summary, another_array):
        assert (folder / "report.html").read_bytes() == expected


def test_pictures_beside_the_page_go_when_it_is_to_stand_alone(tmp_path: Path) -> None:
    folder = write_run(tmp_path, {**summary(), "sheet": []})
    written = write_reports(folder, beside=True)
    beside = sorted((folder / "report_files").iterdir())
    assert beside
    assert set(beside) < set(written)
    (folder / "report_files" / "mine.txt").write_text("of somebody")
    again = write_reports(folder)
    assert set(again) == set(written) - set(beside)
    assert [path.name for path in (folder / "report_files").iterdir()] == ["mine.txt"]
