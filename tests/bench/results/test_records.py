"""Records: made of finished runs, sealed, refused once changed, and shown beside a run of the suite."""

import json
import logging
import re
import shutil
from dataclasses import replace
from pathlib import Path
from statistics import fmean

import pytest

from bench.fake_method import FakeSweep, asked, write_sweep
from radiogs_bench.cli import main
from radiogs_bench.cli.plan import show_plan
from radiogs_bench.results import records
from radiogs_bench.results.records import RECORDS, read_record, record_of, records_of, write_record
from radiogs_bench.runs.sweep import read_sweep, recipe_of_rows
from radiogs_bench.store.folder import Store
from radiogs_bench.suites.consistency import RIVALS
from radiogs_bench.suites.paper import ABLATIONS, NS
from radiogs_core.errors import DataError
from radiogs_reports.tables.record import HEADING
from radiogs_reports.write.record import record_document, record_page

ROOT = Path(__file__).parents[3]
PAGES = ROOT / "docs" / "records"
MOST_WORDS = 600


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of two rows and two seeds, whose manifest states a recipe."""
    folder = tmp_path_factory.mktemp("run")
    sweep, request = FakeSweep(folder), asked(2, replace(ABLATIONS, rows=ABLATIONS.rows[:2]))
    cells = request.cells
    stated = request.manifest()
    for row in stated["rows"]:
        row["recipe"] = "twice the steps"
    stated["command"] = ["run", "ablations", "--out", str(folder), "--seeds", "2"]
    write_sweep(sweep.store, stated)
    sweep.run([cell for _, cell in cells])
    return folder


@pytest.fixture(scope="module")
def made(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the record of the run and its document."""
    folder = tmp_path_factory.mktemp("records")
    record, document = folder / "ablations.json", folder / "ablations.md"
    assert main(["record", str(run), "--to", str(record), "--document", str(document)]) == 0
    return folder


@pytest.fixture
def record(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The record of the run, as if it came with the package."""
    folder = shutil.copytree(made, tmp_path / "records")
    monkeypatch.setattr(records, "RECORDS", folder)
    return folder / "ablations.json"


def test_a_record_holds_the_table_of_its_run_and_the_differences_of_each_scene(run: Path, record: Path) -> None:
    (kept,) = read_record(record)
    assert kept["recipe"] == "twice the steps"
    assert kept["origin"]["Command"] == "radiogs-bench run ablations --seeds 2"
    store, refs = Store(run), json.loads((run / "sweep.json").read_text())["cells"]
    results = {(ref["row"], ref["seed"]): store.result(ref["key"]) for ref in refs}
    values = {place: result["metrics"]["nvs/psnr"]["value"] for place, result in results.items() if result is not None}
    of_seeds = [values["no-rad", seed] - values["ours", seed] for seed in (0, 1)]  # type: ignore[operator]
    cell = kept["cells"]["no-rad"]["nvs/psnr"]
    assert cell["by_scene"] == [pytest.approx(fmean(of_seeds), rel=1e-5)]
    assert cell["difference"] is not None
    assert cell["difference"]["mean"] == cell["by_scene"][0]
    assert kept["cells"]["ours"]["nvs/psnr"]["by_scene"] == []
    assert sorted(kept["keys"].values()) == sorted(ref["key"] for ref in refs)
    assert set(kept["keys"]) == {f"{ref['scene']} {ref['row']} seed {ref['seed']}" for ref in refs}
    assert record.stat().st_size < 20_000


def test_a_record_is_shown_beside_a_run_and_marked(
    run: Path, record: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for there in (True, False):
        capsys.readouterr()
        assert main(["report", str(run), "--no-pictures"]) == 0
        shown = {name: (run / name).read_text() for name in ("ablations.md", "report.html")}
        shown["terminal"] = capsys.readouterr().out
        for name, text in shown.items():
            told = "resolved in both with equal signs" if name == "terminal" else HEADING
            assert (told in text) == there, name
        record.unlink(missing_ok=True)


def test_the_terminal_compares_with_no_record_by_another_recipe_or_of_other_rows(
    run: Path, record: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (kept,) = read_record(record)
    kept["recipe"] = "half the steps"
    write_record(record, [kept])
    assert main(["report", str(run), "--no-pictures"]) == 0
    assert "Record of" not in capsys.readouterr().out
    for row in kept["rows"]:
        row["key"] = f"other-{row['key']}"
    kept["cells"] = {f"other-{key}": cells for key, cells in kept["cells"].items()}
    kept["published"], kept["reference"] = {}, f"other-{kept['reference']}"
    write_record(record, [kept])
    assert main(["report", str(run), "--no-pictures"]) == 0
    assert "Record of" not in capsys.readouterr().out


def test_a_plan_prints_cost_and_power_of_the_matching_record(
    run: Path, record: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    request = asked(2, replace(ABLATIONS, rows=ABLATIONS.rows[:2]))
    (kept,) = read_record(record)
    show_plan(request, Store(tmp_path / "new"), 1, 1, {})
    assert "In the record" not in capsys.readouterr().out  # which is by another recipe
    kept["recipe"] = recipe_of_rows(request.manifest()["rows"])
    for row, seconds in zip(kept["rows"], (300.0, 60.0), strict=True):
        row["seconds"] = seconds
    write_record(record, [kept])
    show_plan(request, Store(tmp_path / "new"), 1, 1, {})
    said = " ".join(capsys.readouterr().out.split())
    assert "training took 12.0 min for these cells, one after the other" in said  # twice 300 + 60 seconds
    (psnr,) = [column for column in kept["columns"] if column["key"] == "nvs/psnr"]
    assert f"(1 scene, 2 seeds) would resolve true differences of NVS PSNR {psnr['smallest']:.2f} dB" in said
    show_plan(asked(2), Store(tmp_path / "new"), 1, 1, {})
    assert "In the record" not in capsys.readouterr().out  # which lacks rows


def test_a_record_keeps_differences_of_pairs_of_rows(tmp_path: Path) -> None:
    sweep, request = FakeSweep(tmp_path / "run"), asked(2, replace(RIVALS, rows=RIVALS.rows[:4]))
    cells = request.cells
    write_sweep(sweep.store, request.manifest())
    sweep.run([cell for _, cell in cells])
    record, document = tmp_path / "rivals.json", tmp_path / "rivals.md"
    assert main(["record", str(tmp_path / "run"), "--to", str(record), "--document", str(document)]) == 0
    (kept,) = read_record(record)
    (found,) = kept["analyses"]
    assert [line[0] for line in found["lines"]] == [
        *["radiometric_weight = 0.2 instead of 0.0"] * 2, *["materials.rates.light = 0.0 instead of 0.01"] * 2,
    ]  # fmt: skip
    written = document.read_text()
    assert all(line in written for line in (found["title"], found["note"], *found["sentences"]))


def test_a_record_keeps_gain_and_cost_of_each_knob(tmp_path: Path) -> None:
    sweep, request = FakeSweep(tmp_path), asked(2, NS)
    cells = request.cells
    write_sweep(sweep.store, request.manifest())
    sweep.run([cell for _, cell in cells])
    found = record_of(sweep.store, read_sweep(tmp_path))["analyses"]
    assert len(found) > 1
    assert found[0]["sentences"]
    assert not any(each["sentences"] for each in found[1:])


def test_a_changed_record_is_refused_and_the_run_is_shown_without_it(
    record: Path, caplog: pytest.LogCaptureFixture
) -> None:
    record.write_text(record.read_text().replace('"twice the steps"', '"half the steps"'))
    with pytest.raises(DataError, match="its content does not agree with its seal"):
        read_record(record)
    with caplog.at_level(logging.WARNING):
        assert records_of("ablations") == []
    assert "cannot use the record" in caplog.text


def test_a_run_with_a_missing_cell_makes_no_record(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    request = asked(1)
    write_sweep(Store(tmp_path), request.manifest())
    assert main(["record", str(tmp_path), "--to", str(tmp_path / "record.json")]) == 3
    assert "5 of 5 cells are not finished" in capsys.readouterr().err
    assert not (tmp_path / "record.json").exists()


def test_the_document_and_the_page_of_a_record_are_written_again_from_the_record_alone(record: Path) -> None:
    document, page = record.with_suffix(".md"), record.with_name("page.md")
    first = document.read_text()
    assert "| λ_rad = 0 | NVS PSNR ↑ (dB) |" in first
    document.unlink()
    assert main(["record", "--to", str(record), "--markdown", str(page), "--document", str(document)]) == 0
    assert document.read_text() == first
    assert page.read_text() == record_page(read_record(record))
    assert main(["record", "--to", str(record)]) == 2


def test_committed_pages_equal_their_records_with_one_short_table_each() -> None:
    found = sorted(RECORDS.glob("*.json"))
    assert {path.stem for path in found} == {path.stem for path in PAGES.glob("*.md")} >= {"ablations", "departures"}
    for path in found:
        text = (PAGES / f"{path.stem}.md").read_text(encoding="utf-8")
        assert text == record_page(read_record(path)), path
        assert len(text.split()) <= MOST_WORDS
        assert len(re.findall(r"\n\n\|", text)) == 1
        for run in read_record(path):
            assert all(run["origin"][name] in text for name in ("Date", "Commit", "Command"))


MARKED = re.compile(r"<!-- from records/([\w-]+)\.md -->\n(.*?)<!-- end of record -->", re.DOTALL)
"""A part of a document whose values come from a record."""


def marked() -> list[tuple[Path, str, str]]:
    """Document, record and text of every part between marks."""
    documents = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    return [(path, *found) for path in documents for found in MARKED.findall(path.read_text(encoding="utf-8"))]


def cells_of(line: str) -> set[str]:
    return set(line.strip("| ").split(" | "))


@pytest.mark.parametrize(("document", "name", "block"), marked(), ids=lambda value: getattr(value, "stem", None))
def test_a_document_has_the_values_of_the_record_that_it_names(document: Path, name: str, block: str) -> None:
    """Every line of a table is part of a line of the whole record, and every number of a sentence is in the record."""
    text = record_document(read_record(RECORDS / f"{name}.json"))
    lines = [cells_of(line) for line in text.splitlines() if line.startswith("|")]
    tables = [line for line in block.splitlines() if line.startswith("|")]
    for line in tables[2:]:
        assert any(cells_of(line) <= each for each in lines), f"{document}: {line}"
    said = "\n".join(line for line in block.splitlines() if not line.startswith("|"))
    for number in re.findall(r"[+-]?\d+\.\d+", said):
        assert number in text, f"{document}: {number}"
    assert tables or re.search(r"\d\.\d", said)


def test_the_readme_has_a_table_of_a_record() -> None:
    assert any(document.name == "README.md" and "|" in block for document, _, block in marked())
