"""The walks of CONTRIBUTING.md are applied to a copy of the tree: their tests pass and their mutant is noticed."""

import ast
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
PACKAGES = ("method", "datasets", "baselines", "reports", "radiogs_bench")

COPY = re.compile(r"^Copy \[[^\]]+\]\((?P<source>[^)]+)\) to\s`(?P<target>[^`]+)`", re.MULTILINE)
CODE = r",?\s?\w*:\n\n```\w+\n(?P<code>.*?)```\n"
WRITE = re.compile(r"^Write `(?P<target>[^`]+)`" + CODE, re.MULTILINE | re.DOTALL)
INSERT = re.compile(r"^In `(?P<target>[^`]+)`, below `(?P<anchor>[^`]+)`,\swrite" + CODE, re.MULTILINE | re.DOTALL)
REPLACE = re.compile(r"^In `(?P<target>[^`]+)`, replace `(?P<before>[^`]+)` by\s`(?P<after>[^`]+)`\.", re.MULTILINE)
APPEND = re.compile(r"^In `(?P<target>[^`]+)`, at the end,\swrite" + CODE, re.MULTILINE | re.DOTALL)

MADE = {match["target"] for pattern in (COPY, WRITE) for match in pattern.finditer(TEXT)}
PATHS = sorted(set(re.findall(r"`([\w.-]+/(?:[\w./-]*(?:\.\w+|/))?)`", TEXT)) - MADE)
LINKS = sorted(set(re.findall(r"\]\(([^)#]+)\)", TEXT)))
SYMBOLS = sorted(set(re.findall(r"`(\w+)`\s(?:in|of)\s`([\w./]+\.py)`", TEXT)))


def defined(path: Path) -> set[str]:
    """Names of a module's functions, classes and assignments."""
    names = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        names |= {target.id for target in targets if isinstance(target, ast.Name)} | {getattr(node, "name", "")}
    return names


def python(folder: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """Run Python on the packages and tests of a tree."""
    roots = [folder, *(folder / name for name in (*PACKAGES, "tests"))]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, roots))}
    command = [sys.executable, *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def changed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the tree with all walks applied; scenes are not copied."""
    folder = tmp_path_factory.mktemp("walks")
    for name in PACKAGES:
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__", "tiny", "forward"))
    for name in ("tiny", "forward"):
        (folder / "datasets/radiogs_datasets" / name).symlink_to(ROOT / "datasets/radiogs_datasets" / name)
    shutil.copytree(ROOT / ".ci", folder / ".ci")
    for name in ("metrics", "datasets", "method/radiogs"):
        (folder / "tests" / name).mkdir(parents=True)
    for file in ("pyproject.toml", "tests/conftest.py", "tests/elsewhere.py", "tests/scenes.py", "tests/known_ball.py"):
        shutil.copy(ROOT / file, folder / file)
    for match in COPY.finditer(TEXT):
        shutil.copy(ROOT / match["source"], folder / match["target"])
    for match in WRITE.finditer(TEXT):
        (folder / match["target"]).write_text(match["code"], encoding="utf-8")
    for match in INSERT.finditer(TEXT):
        text = (folder / match["target"]).read_text(encoding="utf-8")
        assert text.count(f"\n{match['anchor']}\n") == 1, f"{match['target']} has not one line: {match['anchor']}"
        below = text.replace(f"\n{match['anchor']}\n", f"\n{match['anchor']}\n{match['code']}")
        (folder / match["target"]).write_text(below, encoding="utf-8")
    for match in REPLACE.finditer(TEXT):
        text = (folder / match["target"]).read_text(encoding="utf-8")
        assert text.count(f"\n{match['before']}\n") == 1, f"{match['target']} has not one line: {match['before']}"
        (folder / match["target"]).write_text(text.replace(match["before"], match["after"]), encoding="utf-8")
    for match in APPEND.finditer(TEXT):
        with (folder / match["target"]).open("a", encoding="utf-8") as file:
            file.write("\n" + match["code"])
    return folder


def test_every_block_of_code_belongs_to_a_step() -> None:
    steps = [match for pattern in (WRITE, INSERT, APPEND) for match in pattern.finditer(TEXT)]
    assert len(re.findall(r"^```(?:python|toml)$", TEXT, re.MULTILINE)) == len(steps)
    assert len(COPY.findall(TEXT)) == TEXT.count("\nCopy [")
    assert len(REPLACE.findall(TEXT)) == TEXT.count("`, replace `")


def test_every_example_is_part_of_a_walk() -> None:
    used = {ROOT / match["source"] for match in COPY.finditer(TEXT)}
    assert used == {path for path in (ROOT / "docs/examples/extending").iterdir() if path.is_file()}


@pytest.mark.parametrize("path", [*PATHS, *LINKS])
def test_every_named_file_exists(path: str) -> None:
    assert (ROOT / path).exists()


@pytest.mark.parametrize(("symbol", "path"), SYMBOLS)
def test_every_named_symbol_is_defined(symbol: str, path: str) -> None:
    assert symbol in defined(ROOT / path)


@pytest.mark.parametrize("folder", [*PACKAGES, "tests"])
def test_every_file_that_a_folder_names_exists(folder: str) -> None:
    text = (ROOT / folder / "README.md").read_text(encoding="utf-8")
    named = re.findall(r"`([\w./]+(?:/|\.py))`", text)
    assert len(named) > 1
    packages = [path.parent for path in (ROOT / folder).glob("*/__init__.py")]
    inner = [path for package in packages for depth in ("*/", "*/*/") for path in package.glob(depth)]
    roots = [ROOT, ROOT / folder, *packages, *inner]
    assert [name for name in named if not any((root / name).exists() for root in roots)] == []


def test_there_is_something_to_check() -> None:
    assert len(PATHS) > 15
    assert len(SYMBOLS) > 5


@pytest.mark.slow
def test_the_tests_of_the_walks_pass(changed: Path) -> None:
    tests = sorted(target for target in MADE if target.startswith("tests/"))
    assert len(tests) == 3
    done = python(changed, "-m", "pytest", "-q", *tests)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_the_mutant_of_the_walk_is_noticed(changed: Path) -> None:
    mutant = tomllib.loads((changed / ".ci/mutants.toml").read_text(encoding="utf-8"))["mutant"][-1]
    assert mutant["file"] in MADE
    file = changed / mutant["file"]
    sound = file.read_text(encoding="utf-8")
    assert sound.count(mutant["before"]) == 1
    file.write_text(sound.replace(mutant["before"], mutant["after"]), encoding="utf-8")
    try:
        done = python(changed, "-m", "pytest", "-q", *mutant["tests"])
    finally:
        file.write_text(sound, encoding="utf-8")
    assert done.returncode == 1, done.stdout + done.stderr
    assert "1 failed" in done.stdout


def test_the_changed_tree_has_no_finding_once_its_imports_are_sorted(changed: Path) -> None:
    for fix in (["--fix"], []):
        done = python(changed, "-m", "ruff", "check", *fix, ".")
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_the_changed_tree_keeps_the_structure(changed: Path) -> None:
    """But for the bounds on files, lines and functions, which whoever adds something pays for elsewhere."""
    done = python(changed, ".ci/structure.py")
    *found, ended = done.stdout.splitlines()
    assert ended.endswith(" findings"), done.stdout + done.stderr
    paid = r"\d+ |product files: |(lines|functions) of "
    assert not [line for line in found if not re.match(paid, line)], done.stdout


@pytest.mark.slow
def test_the_suite_of_the_walk_is_one_that_can_be_run(changed: Path) -> None:
    (suite,) = (target for target in MADE if target.endswith(".toml"))
    done = python(changed, "-m", "radiogs_bench", "run", suite, "--dry-run", "--preset", "smoke", "--out", "out")
    assert done.returncode == 0, done.stdout + done.stderr
    assert all(row in done.stdout for row in ("ours", "no-rad"))
