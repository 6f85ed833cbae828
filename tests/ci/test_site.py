"""The documentation builds as a site: every page is in its menu, no link is dead, and nothing is asked of a network."""

import re
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "-d", str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return out


class Addresses(HTMLParser):
    """The addresses that a page links to, and those that it loads."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        found = dict(attributes)
        if tag == "a" and found.get("href"):
            self.links.append(str(found["href"]))
        if tag in ("img", "script"):
            self.loaded.append(found.get("src") or "")
        if tag == "link" and found.get("rel") == "stylesheet":
            self.loaded.append(str(found["href"]))


def pages(site: Path) -> Iterator[tuple[Path, Addresses]]:
    for path in sorted(site.rglob("*.html")):
        yield path, Addresses(path.read_text(encoding="utf-8"))


def test_every_document_is_a_page_that_the_menu_leads_to(site: Path) -> None:
    _, front = next(each for each in pages(site) if each[0] == site / "index.html")
    there = {link.partition("#")[0].removesuffix("index.html").strip("./") for link in front.links}
    documents = {path.relative_to(DOCS).with_suffix("").as_posix() for path in DOCS.rglob("*.md")}
    documents = {name for name in documents if not name.startswith("notebook/")}
    assert documents - there == set()
    assert len(documents) > 20


def test_links_between_pages_lead_somewhere_and_nothing_is_loaded_from_elsewhere(site: Path) -> None:
    followed = 0
    for path, found in pages(site):
        if path.name == "404.html":
            continue
        assert not [address for address in found.loaded if re.match(r"(https?:)?//", address)], path
        for address in (*found.links, *found.loaded):
            target = address.partition("#")[0]
            if not target or re.match(r"[a-z]+:", target):
                continue
            place = (path.parent / target).resolve()
            assert (place / "index.html" if place.is_dir() else place).exists(), f"{path.name}: {address}"
            followed += 1
    assert followed > 500


def test_links_to_sources_name_the_file_instead(site: Path) -> None:
    text = (site / "what_images_determine" / "index.html").read_text(encoding="utf-8")
    assert '<abbr title="radiogs_bench/suites/own.py">oracles.py</abbr>' in text
