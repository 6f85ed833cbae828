"""The check of links to lines of code finds what has moved, and sets it right."""

from pathlib import Path
from types import ModuleType

import pytest

from ci_scripts import script


@pytest.fixture(scope="module")
def links() -> ModuleType:
    return script("code_links")


def test_links_follow_what_they_name(links: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "rays.py").write_text(
        "import math\n\n\nclass Rays:\n    @property\n    def trace(self):\n        pass\n"
    )
    right, moved, gone = (
        f'[x](rays.py#L{line} "{name}")' for line, name in ((4, "Rays"), (4, "Rays.trace"), (4, "Ray"))
    )
    assert links.renewed(right, tmp_path) == (right, [])
    assert links.renewed(moved, tmp_path) == ('[x](rays.py#L6 "Rays.trace")', ["rays.py#L4: Rays.trace is in line 6"])
    assert links.renewed(gone, tmp_path) == (gone, ["rays.py defines no Ray"])
    assert links.renewed('[x](none.py#L4 "Rays")', tmp_path)[1] == ["none.py defines no Rays"]
    plain = "[x](rays.py) and [y](rays.py#L9)"
    assert links.renewed(plain, tmp_path) == (plain, [])


def test_the_documents_of_this_project_have_such_links_and_all_hold(
    links: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    baselines = (links.ROOT / "docs" / "baselines.md").read_text()
    assert len(links.LINK.findall(baselines)) >= 35, "each cell of the table of methods"
    assert links.main(write=False) == 0, capsys.readouterr().out
