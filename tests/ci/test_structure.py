"""The check of the house's structure finds what it is there for, on packages that are made to have it."""

from pathlib import Path
from types import ModuleType

import pytest

from ci_scripts import script
from radiogs_bench.sources import SourceTree, installed


@pytest.fixture(scope="module")
def structure() -> ModuleType:
    return script("structure")


def house(folder: Path, fill: int = 5, **texts: str) -> SourceTree:
    """Packages ``radiogs`` and ``house``; the modules of the second by their dotted names, with two underscores.

    ``fill``: empty modules in each folder besides.
    """
    for name, text in {"radiogs/method": "", **{f"house/{name}": text for name, text in texts.items()}}.items():
        path = folder / f"{name.replace('__', '/')}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    for inner in [folder / "radiogs", *(folder / "house").rglob("*/"), folder / "house"]:
        for name in ("__init__", *(f"empty{number}" for number in range(fill))):
            (inner / f"{name}.py").touch()
    return SourceTree({name: folder / name for name in ("radiogs", "house")})


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        (
            {"one__a": "from ..two import b\n", "two__c": "def late():\n    from ..one.d import x\n", "one__d": ""},
            "house.one <-> house.two",
        ),
        (
            {
                "one__a": "from ..two import b\n",
                "two__c": "from house.three.d import x\n",
                "three__e": "import house.one.f\n",
                **dict.fromkeys(("two__b", "three__d", "one__f"), ""),
            },
            "house.one <-> house.three <-> house.two",
        ),
        ({"one__a": "def f(" + ", ".join(f"p{n}" for n in range(8)) + "): ...\n"}, "house.one.a:1 f: 8 parameters"),
        ({"one__a": "class C:\n    def f(self):\n" + "        x = 1\n" * 60}, "f: 61 lines"),
        ({"one__a": "def f():\n    from radiogs.method import X\n"}, "house.one.a imports radiogs.method"),
        (
            {"one__a": "from . import b\n", "one__b": "def late():\n    from .a import x\n"},
            "circle of files: house.one.",
        ),
        ({f"one__m{number}": "" for number in range(26)}, "house/one: 31 files (5 to 30)"),
    ],
)
def test_wrong_structure_is_found(texts: dict[str, str], said: str, structure: ModuleType, tmp_path: Path) -> None:
    found = structure.findings(house(tmp_path, **texts), "house")
    assert len(found) == 1
    assert said in found[0]


def test_correct_structure_causes_no_finding(structure: ModuleType, tmp_path: Path) -> None:
    tree = house(
        tmp_path,
        one__a="from ..two import b\nfrom .inner import c\n",
        one__inner__c="from ..d import e\n",  # rooms within a room may look out
        one__d="e = 1\n",
        two__b="def f(self, " + ", ".join(f"p{n}" for n in range(7)) + "):\n" + "    x = 1\n" * 59,
    )
    assert structure.findings(tree, "house") == []


def test_a_folder_with_few_files_is_found_and_kernels_text_counts(structure: ModuleType, tmp_path: Path) -> None:
    tree = house(tmp_path, fill=0, one__a="", one__b="", one__c="", **{f"m{number}": "" for number in range(5)})
    assert structure.findings(tree, "house") == ["house/one: 3 files (5 to 30)"]
    for name in ("a", "b"):
        (tmp_path / "house" / "one" / f"{name}.inl").touch()
    assert structure.findings(tree, "house") == []


def test_pieces_are_counted(structure: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Imports within functions make users, imports of a file by itself do not."""
    texts = {
        "house/one/a.py": "from ..two import b, c\nfrom . import d\n",
        "house/one/d.py": "from . import d\nfrom ..two.c import x\n",
        "house/two/b.py": "def late():\n    from .e import y\n", "house/two/c.py": "",
        "house/two/e.py": "import numpy\ndef f():\n    def g():\n" + 24 * "        x = 1\n",
        "house/two/k.inl": "float x;\n\n", "house/page/p.js": "1;\n", "house/page/vendor/v.js": "1;\n",
        "tests/test_a.py": "\n",
    }  # fmt: skip
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(structure, "HARNESS", "house")
    tree = SourceTree({"house": tmp_path / "house"})
    modules = ["house.one.a", "house.one.d", "house.two.b", "house.two.c", "house.two.e"]
    assert structure.with_one_user(tree, modules) == {
        "house.two.b": "house.one.a", "house.one.d": "house.one.a", "house.two.e": "house.two.b",
    }  # fmt: skip
    assert structure.counts(tree, modules, tmp_path / "tests") == {
        "product files": 5, "files with one user": 3, "arrows between folders of the harness": 1,
        "long functions of a thousand": 334, "lines of house": 33, "functions of house": 3,
        "lines of kernels' C++": 2, "lines of the page's JavaScript": 1, "lines of tests": 1,
    }  # fmt: skip
    monkeypatch.setattr(structure, "TABLES", ("house.one.a",))
    assert structure.with_one_user(tree, modules) == {"house.two.e": "house.two.b"}


def test_a_folder_of_tests_with_too_many_files_is_found(structure: ModuleType, tmp_path: Path) -> None:
    for number in range(31):
        (tmp_path / "tests" / "room").mkdir(parents=True, exist_ok=True)
        (tmp_path / "tests" / "room" / f"test_{number}.py").touch()
        (tmp_path / "tests" / "__init__.py").touch()
    assert list(structure.sizes_of_test_folders(tmp_path / "tests")) == ["tests/room: 31 files (at most 30)"]


def test_every_table_is_a_file(structure: ModuleType) -> None:
    assert [name for name in structure.TABLES if installed().file(name) is None] == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("from bench.test_cell import made\n", "imports test_cell"),
        ("from . import test_cell\n", "imports test_cell"),
        ("import bench.test_cell\n", "imports test_cell"),
        ("from radiogs.method import _late\n", "imports _late"),
        ("import house\nhouse._late()\n", "uses _late"),
        ("def test(house):\n    house.method.kept._kept\n", "uses _kept"),
        ("def test(patch, house):\n    patch.setattr(house, '_LIMIT', 1)\n", "uses _LIMIT"),
        ("def test(patch, house):\n    with patch.object(house, '_Inner'):\n        pass\n", "uses _Inner"),
        ("import os\nos._exit(0)\n", ""),
        ("class Own:\n    def f(self):\n        self._kept = 1\n", ""),
        ("from house.cell import made\nfrom scenes import sphere\n_late = made()\n", ""),
    ],
)
def test_forbidden_uses_by_tests_are_found(structure: ModuleType, text: str, said: str, tmp_path: Path) -> None:
    tree = house(
        tmp_path,
        cell="_LIMIT: int = 2\ndef _late(): ...\nclass _Inner:\n    def __init__(self):\n        self._kept = 1\n",
    )
    private = structure.private_names(tree, ["house.cell"])
    assert private == {"_LIMIT", "_late", "_Inner", "_kept"}
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests" / "test_it.py").write_text(text)
    found = list(structure.reaching(tmp_path / "tests", private))
    assert [each.partition(" ")[2] for each in found] == ([said] if said else [])
