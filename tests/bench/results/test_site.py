"""A published site: the stored values, whose pictures it shows, what it leaves alone, and that its text is inert."""

import hashlib
import json
import shutil
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import pytest

from chromium import DESK, Watched, browser, needed, playwright
from radiogs_bench.cli import main
from radiogs_bench.results.site import licence_of
from radiogs_bench.store.seal import sealed
from radiogs_datasets import load_scene

__all__ = ["browser"]

EVIL = "<script>document.title='taken'</script><img src=https://host.example/x>"
HOME = "/home/somebody/secret"


def changed(out: Path, change: Callable[[dict], None]) -> None:
    """Change the manifest of a run, and seal it again."""
    sweep = json.loads((out / "sweep.json").read_text())
    change(sweep)
    (out / "sweep.json").write_text(json.dumps(sealed(sweep)))


def keep_two_rows(sweep: dict) -> None:
    sweep["rows"] = sweep["rows"][:2]
    keys = [row["key"] for row in sweep["rows"]]
    sweep["cells"] = [ref for ref in sweep["cells"] if ref["row"] in keys]


@pytest.fixture
def out(finished: Path, tmp_path: Path) -> Path:
    """A finished run of two rows and three seeds."""
    out = shutil.copytree(finished, tmp_path / "out")
    changed(out, keep_two_rows)
    return out


def hostile(sweep: dict) -> None:
    """Such names of a row and of the scene, and a command with folders."""
    sweep["rows"][0]["text"], sweep["scenes"] = EVIL, [EVIL]
    sweep["command"] = ["run", "ablations", "--out", HOME, "--data", HOME, f"--trust={HOME}/it.toml"]
    for ref in sweep["cells"]:
        ref["scene"] = EVIL


def files(site: Path) -> dict[str, bytes]:
    return {path.relative_to(site).as_posix(): path.read_bytes() for path in site.rglob("*") if path.is_file()}


def published(out: Path, site: Path, *further: str) -> list[dict]:
    assert main(["publish", str(out), "--to", str(site), *further]) == 0
    return json.loads((site / "data.json").read_text())["lines"]


def test_a_site_holds_the_means_over_seeds_and_the_digests_of_all_files(out: Path, tmp_path: Path) -> None:
    site, before = tmp_path / "site", files(out)
    line = published(out, site, "--with-pictures-of", "fake")[0]
    keys = [ref["key"] for ref in json.loads((out / "sweep.json").read_text())["cells"] if ref["row"] == "ours"]
    stored = [json.loads((out / f"cells/{key}.json").read_text())["metrics"]["nvs/psnr"]["value"] for key in keys]
    assert line["values"]["mean"]["nvs/psnr"] == pytest.approx(sum(stored) / 3)
    assert line["values"]["seed 1"]["nvs/psnr"] == stored[1]
    digest = hashlib.sha256((out / f"cells/{keys[0]}.json").read_bytes()).hexdigest()
    page = (site / line["page"]).read_text()
    assert f"{digest}  cells/{keys[0]}.json" in page
    assert page.count("<img") == 2  # the truth beside what was rendered
    made = files(site)
    listed = dict(each.split("  ")[::-1] for each in made.pop("checksums.txt").decode().splitlines())
    assert listed == {name: hashlib.sha256(content).hexdigest() for name, content in made.items()}
    published(out, site, "--with-pictures-of", "fake")
    assert {**files(site), "checksums.txt": b""} == {**made, "checksums.txt": b""}
    assert files(out) == before


@pytest.mark.parametrize(
    ("licence", "shown"),
    [("CC BY 4.0, public domain", True), ("CC BY 4.0, CC BY-NC 4.0", False), ("CC BY-ND 4.0", False), ("", False)],
)
def test_pictures_are_shown_by_licence_alone(licence: str, shown: bool, out: Path, tmp_path: Path) -> None:
    changed(out, lambda sweep: sweep.update(stated={"fake": {"licence": licence} if licence else {}}))
    line = published(out, tmp_path / "site")[0]
    assert (tmp_path / "site/pictures").exists() == shown
    assert (f"the licence of fake is {licence or 'not known'}" in line["without"]) != shown


def test_a_scene_of_the_package_is_known_by_its_files_and_not_by_its_name() -> None:
    assert licence_of("corner", load_scene("corner").checksum, {})[2]
    assert not licence_of("corner", "0" * 64, {})[2]


def test_missing_cells_are_named_and_changed_ones_are_refused(out: Path, tmp_path: Path) -> None:
    cell = next((out / "cells").glob("*.json"))
    content = cell.read_text()
    cell.unlink()
    lines = published(out, tmp_path / "site")
    assert [len(line["missing"]) for line in lines if line["missing"]] == [1]
    assert lines[0]["facts"]["division"] == "open"
    cell.write_text(content.replace('"value": ', '"value": 1'))
    assert main(["publish", str(out), "--to", str(tmp_path / "other")]) == 3
    assert not (out / "aside").exists()
    assert not (tmp_path / "other").exists()


def test_only_unchanged_files_of_an_earlier_site_are_removed(out: Path, tmp_path: Path) -> None:
    site, victim = tmp_path / "site", tmp_path / "victim"
    shown = [site / line["page"] for line in published(out, site)]
    victim.write_text("mine")
    (site / "own.txt").write_text("mine")
    shown[0].write_text("edited")
    mine = hashlib.sha256(b"mine").hexdigest()
    with (site / "checksums.txt").open("a") as file:
        file.write(f"{mine}  ../victim\n{mine}  pages/../own.txt\n")
    changed(out, lambda sweep: sweep.update(title="another"))  # pages have other names
    published(out, site)
    assert [path.exists() for path in (*shown, victim, site / "own.txt")] == [True, False, True, True]
    assert main(["publish", str(out), "--to", str(out)]) == 2


@needed
def test_stored_text_is_inert_and_no_folder_is_named(browser: "playwright.Browser", out: Path, tmp_path: Path) -> None:
    changed(out, hostile)
    line = published(out, tmp_path / "site")[0]
    assert line["facts"]["command"] == "radiogs-bench run ablations --data secret --trust=it.toml"
    for name, content in files(tmp_path / "site").items():
        assert str(tmp_path).encode() not in content
        assert HOME.encode() not in content
        tags: list[str] = []
        parser = HTMLParser()
        parser.handle_starttag = lambda tag, attributes, tags=tags: tags.append(tag)  # type: ignore[method-assign]
        parser.feed(content.decode() if name.endswith(".html") else "")
        assert (tags.count("script"), tags.count("img")) == (name.endswith(".html"), 0)
    watched = Watched(browser, tmp_path / "site/index.html", viewport=DESK)
    assert watched.page.title() == "Results · radiogs-bench"
    assert EVIL in watched.page.locator("tbody tr").first.inner_text()
    watched.close()


@needed
def test_the_table_filters(browser: "playwright.Browser", out: Path, tmp_path: Path) -> None:
    record = Path(__file__).parents[3] / "radiogs_bench/records/closed.json"
    assert len(published(out, tmp_path / "site", str(record))) == 2 + 4 * 2
    watched = Watched(browser, tmp_path / "site/index.html", viewport=DESK)
    shown = watched.page.locator("tbody tr:visible")
    watched.page.get_by_label("division").select_option("closed")
    assert shown.count() == 2
    watched.page.get_by_label("suite").select_option("ablations")
    assert shown.count() == 0
    watched.close()
