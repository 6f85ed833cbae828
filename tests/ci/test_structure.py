"""The check of the house's structure finds what it is there for, on packages that are made to have it."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

from radiogs_bench.sources import OURS, SourceTree, installed

SCRIPT = Path(__file__).parents[2] / ".ci" / "structure.py"


@pytest.fixture(scope="module")
def structure() -> ModuleType:
    spec = importlib.util.spec_from_file_location("structure", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def house(folder: Path, **texts: str) -> SourceTree:
    """Packages ``radiogs`` and ``house``; the modules of the second by their dotted names, with two underscores."""
    for name, text in {"radiogs/method": "", **{f"house/{name}": text for name, text in texts.items()}}.items():
        path = folder / f"{name.replace('__', '/')}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    for inner in [folder / "radiogs", *(folder / "house").rglob("*/"), folder / "house"]:
        (inner / "__init__.py").touch()
    return SourceTree({name: folder / name for name in ("radiogs", "house")})


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        (
            {"one__a": "from ..two import b\n", "two__b": "def late():\n    from ..one.a import x\n"},
            "house.one <-> house.two",
        ),
        (
            {
                "one__a": "from ..two import b\n",
                "two__b": "from house.three.c import x\n",
                "three__c": "import house.one.a\n",
            },
            "house.one <-> house.three <-> house.two",
        ),
        ({"one__a": "def f(" + ", ".join(f"p{n}" for n in range(8)) + "): ...\n"}, "house.one.a:1 f: 8 parameters"),
        ({"one__a": "class C:\n    def f(self):\n" + "        x = 1\n" * 60}, "f: 61 lines"),
        ({"one__a": "def f():\n    from radiogs.method import X\n"}, "house.one.a imports radiogs.method"),
    ],
)
def test_what_is_wrong_is_found(texts: dict[str, str], said: str, structure: ModuleType, tmp_path: Path) -> None:
    found = structure.findings(house(tmp_path, **texts), "house")
    assert len(found) == 1
    assert said in found[0]


def test_what_is_right_is_not(structure: ModuleType, tmp_path: Path) -> None:
    tree = house(
        tmp_path,
        one__a="from ..two import b\nfrom .inner import c\n",
        one__inner__c="from ..d import e\n",  # rooms within a room may look out
        one__d="e = 1\n",
        two__b="def f(self, " + ", ".join(f"p{n}" for n in range(7)) + "):\n" + "    x = 1\n" * 59,
    )
    assert structure.findings(tree, "house") == []


def test_this_house_has_nothing_wrong(structure: ModuleType) -> None:
    assert structure.findings(installed(), *OURS) == []
