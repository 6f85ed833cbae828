"""A published site: the stored values, whose pictures it shows, what it leaves alone, and that its text is inert."""

import hashlib
import json
import re
import shutil
from pathlib import Path

import pytest

from chromium import DESK, Watched, browser, needed, playwright
from radiogs_bench.cli import main
from radiogs_bench.results.records import RECORDS
from radiogs_bench.results.site import licence_of
from radiogs_bench.store.seal import sealed
from radiogs_datasets import load_scene

__all__ = ["browser"]

EVIL = "<script>document.title='taken'</script><img src=https://host.example/x>"
HOME = "/home/some body/secret"


def change(out: Path, **changes: object) -> list[dict]:
    """Change the manifest of a run, and seal it again; returns its cells."""
    sweep = json.loads((out / "sweep.json").read_text()) | changes
    (out / "sweep.json").write_text(json.dumps(sealed(sweep)))
    return sweep["cells"]


@pytest.fixture
def out(finished: Path, tmp_path: Path) -> Path:
    """A finished run of two rows and three seeds."""
    out = shutil.copytree(finished, tmp_path / "out")
    rows = json.loads((out / "sweep.json").read_text())["rows"][:2]
    keys = [row["key"] for row in rows]
    change(out, rows=rows, cells=[ref for ref in change(out) if ref["row"] in keys])
    return out


def files(site: Path) -> dict[str, bytes]:
    return {path.relative_to(site).as_posix(): path.read_bytes() for path in site.rglob("*") if path.is_file()}


def published(out: Path, site: Path, *further: str) -> list[dict]:
    assert main(["publish", str(out), "--to", str(site), *further]) == 0
    return json.loads((site / "data.json").read_text())["lines"]


def test_a_site_holds_the_means_over_seeds_and_the_digests_of_all_files(out: Path, tmp_path: Path) -> None:
    site, before = tmp_path / "site", files(out)
    line = published(out, site, "--with-pictures-of", "fake")[0]
    cells = [f"cells/{ref['key']}.json" for ref in change(out) if ref["row"] == "ours"]
    stored = [json.loads((out / cell).read_text())["metrics"]["nvs/psnr"]["value"] for cell in cells]
    assert line["values"]["mean"]["nvs/psnr"] == pytest.approx(sum(stored) / 3)
    assert line["values"]["seed 1"]["nvs/psnr"] == stored[1]
    page = (site / line["page"]).read_text()
    assert f"{hashlib.sha256((out / cells[0]).read_bytes()).hexdigest()}  {cells[0]}" in page
    assert page.count("<img") == 2  # the truth beside what was rendered
    made = files(site)
    listed = dict(each.split("  ")[::-1] for each in made["checksums.txt"].decode().splitlines())
    assert listed == {name: hashlib.sha256(made[name]).hexdigest() for name in made.keys() - {"checksums.txt"}}
    published(out, site, "--with-pictures-of", "fake")
    assert files(site) == made
    assert files(out) == before


@pytest.mark.parametrize(("licence", "shown"), [("CC BY 4.0, CC0", True), ("CC0, CC BY-NC 4.0", False), ("", False)])
def test_pictures_are_shown_by_licence_alone(licence: str, shown: bool, out: Path, tmp_path: Path) -> None:
    change(out, stated={"fake": {"licence": licence} if licence else {}})
    line = published(out, tmp_path / "site")[0]
    assert (tmp_path / "site/pictures").exists() == shown
    assert (f"the licence of fake is {licence or 'not known'}" in line["without"]) != shown


def test_a_scene_of_the_package_is_known_by_its_files_and_not_by_its_name() -> None:
    assert licence_of("corner", load_scene("corner").checksum, {})[2]
    assert not licence_of("corner", "0" * 64, {})[2]


def test_missing_cells_are_named_and_changed_ones_are_refused(out: Path, tmp_path: Path) -> None:
    cell = out / f"cells/{change(out)[0]['key']}.json"
    content = cell.read_text()
    cell.unlink()
    assert [len(line["missing"]) for line in published(out, tmp_path / "site")] == [1, 0]
    cell.write_text(content.replace('"value": ', '"value": 1'))
    assert main(["publish", str(out), "--to", str(tmp_path / "other")]) == 3
    assert not (out / "aside").exists()
    assert not (tmp_path / "other").exists()


def test_only_unchanged_files_of_an_earlier_site_are_removed(out: Path, tmp_path: Path) -> None:
    site, victim, mine = tmp_path / "site", tmp_path / "victim", hashlib.sha256(b"mine").hexdigest()
    shown = [site / line["page"] for line in published(out, site)]
    for path, text in ((victim, "mine"), (site / "own.txt", "mine"), (shown[0], "edited")):
        path.write_text(text)
    with (site / "checksums.txt").open("a") as file:
        file.write(f"{mine}  ../victim\n{mine}  pages/../own.txt\n")
    change(out, title="another")  # pages have other names
    published(out, site)
    assert [path.exists() for path in (*shown, victim, site / "own.txt")] == [True, False, True, True]
    assert main(["publish", str(out), "--to", str(out)]) == 2


@needed
def test_stored_text_is_inert_and_the_table_filters(browser: "playwright.Browser", out: Path, tmp_path: Path) -> None:
    site, rows = tmp_path / "site", json.loads((out / "sweep.json").read_text())["rows"]
    command = ["run", "ablations", "--out", HOME, "--data", HOME, f"--trust={HOME}/it.toml"]
    cells = [{**ref, "scene": EVIL} for ref in change(out)]
    change(out, rows=[{**row, "text": f"{EVIL} /srv/it"} for row in rows], scenes=[EVIL], cells=cells, command=command)
    lines = published(out, site, str(RECORDS / "closed.json"))
    assert lines[0]["facts"]["command"] == "radiogs-bench run ablations --data secret --trust=it.toml"
    for name, content in files(site).items():
        assert not re.search(rf"{HOME}|{tmp_path}|/srv", content.decode())
        assert len(re.findall(r"<(?:script|img)\b", content.decode())) == name.endswith(".html") or name == "data.json"
    watched = Watched(browser, site / "index.html", viewport=DESK)
    assert watched.page.title() == "Results · radiogs-bench"
    assert EVIL in watched.page.locator("tbody tr").first.inner_text()
    shown = watched.page.locator("tbody tr:visible")
    assert shown.count() == len(lines) == 2 + 4 * 2
    watched.page.get_by_label("division").select_option("closed")
    assert shown.count() == 2
    watched.page.get_by_label("suite").select_option("ablations")
    assert shown.count() == 0
    watched.close()
