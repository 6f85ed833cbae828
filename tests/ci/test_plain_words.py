"""The check of how sentences open finds the forbidden openings, with their lines, and nothing else."""

from pathlib import Path
from types import ModuleType

import pytest

from ci_scripts import script


@pytest.fixture(scope="module")
def words() -> ModuleType:
    return script("plain_words")


@pytest.mark.parametrize("opening", ["Of", "What", "That of", "Those of", "The same of"])
@pytest.mark.parametrize(
    ("source", "line"),
    [
        ('"""{} a thing."""\n', 1),
        ('class C:\n    """A class.\n\n    {} a thing.\n    """\n', 4),
        ('def f():\n    """{} a thing."""\n', 2),
        ('async def f():\n    """It runs. {} a thing."""\n', 2),
        ('x = 1\n"""{} a thing."""\n', 2),
        ('class C:\n    x: int\n    """A count;\n    it is even. {} a thing."""\n', 4),
        ('"""Items:\n\n- {} a thing\n- another\n"""\n', 3),
        ('"""Items\n- one\n- {} a thing\n"""\n', 3),
        ('"""An aside. ({} a thing.)"""\n', 1),
        ('def f(parser):\n    parser.add_argument("--x", help="{} a thing")\n', 2),
        ("x = 1\n# One line,\n# two lines. {} a thing.\n", 3),
        ('def f(parser):\n    parser.add_parser(\n        "x",\n        description=f"{} a {{thing}}",\n    )\n', 4),
    ],
)
def test_a_forbidden_opening_is_found_with_its_line(words: ModuleType, source: str, line: int, opening: str) -> None:
    found = words.findings(source.replace("{}", opening, 1).replace("{{", "{").replace("}}", "}"), "m.py")
    assert len(found) == 1
    assert found[0].startswith(f"m.py:{line}: ")
    assert opening in found[0]


@pytest.mark.parametrize(
    "source",
    [
        '"""What does a probe cost? It costs two renders."""\n',
        '"""Off by one. Whatever it costs, the same of both, that of one and those of all."""\n',
        '"""The unit (e.g. What-if) of a value, i.e. Of no importance."""\n',
        '"""The same offset as before. Thatch. Those offered."""\n',
        '"""A sentence.\nof two lines; what follows is its rest."""\n',
        'x = "What is a value is no docstring."\n',
        "x = 1  # Of a comment beside code nothing is asked.\n",
        'def f(parser):\n    parser.add_argument("--x", metavar="What", help="a thing")\n',
    ],
)
def test_other_openings_are_left_alone(words: ModuleType, source: str) -> None:
    assert words.findings(source, "m.py") == []


@pytest.mark.parametrize("opening", ["Of", "What", "Those of"])
def test_paragraphs_and_lists_of_documents_are_checked_and_their_tables_code_and_headings_are_not(
    words: ModuleType, opening: str
) -> None:
    text = (
        f"# Title. {opening} a\n\nText. {opening} b.\n\n- {opening} c\n\n| {opening} d |\n\n```sh\n{opening} e\n```\n"
    )
    assert [found.partition(": ")[0] for found in words.document_findings(text, "d.md")] == ["d.md:3", "d.md:5"]


def test_every_folder_of_python_files_is_checked(
    words: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert words.main(tmp_path) == 0
    for folder in ("method", "datasets", "baselines", "reports", "radiogs_bench", "tests", ".ci"):
        inner = tmp_path / folder / "inner"
        inner.mkdir(parents=True)
        (inner / "m.py").write_text('"""Of a thing."""\n')
    capsys.readouterr()
    assert words.main(tmp_path) == 1
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 8
    assert lines[-1] == "7 sentences with a forbidden opening"
    assert {path.name for path in words.ROOT.iterdir() if path.is_dir() and any(path.rglob("*.py"))} >= set(
        words.FOLDERS
    )
