"""The list of mutants is true, and the check of them tells what lives from what dies, on a house of one function."""

import ast
import re
import subprocess
from pathlib import Path
from types import ModuleType

import pytest

from ci_scripts import script

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def mutants() -> ModuleType:
    return script("mutants")


def test_every_mutant_still_applies_once_and_its_tests_are_there(mutants: ModuleType) -> None:
    for mutant in mutants.listed():
        assert mutant.applied((ROOT / mutant.file).read_text()) != (ROOT / mutant.file).read_text()
        assert mutant.tests, mutant.name
        for test in mutant.tests:
            place, _, function = test.partition("[")[0].partition("::")
            files = sorted((ROOT / place).glob("test_*.py")) if (ROOT / place).is_dir() else [ROOT / place]
            written = "\n".join(file.read_text() for file in files)
            assert re.search(rf"^def {function}\(" if function else "^def test_", written, re.M), test


def test_names_are_names(mutants: ModuleType) -> None:
    names = [mutant.name for mutant in mutants.listed()]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize(("text", "times"), [("a = 2\n", 0), ("a = 1\nb = a = 1\n", 2)])
def test_a_mutant_applies_once_or_not_at_all(text: str, times: int, mutants: ModuleType) -> None:
    mutant = mutants.Mutant("m", "f.py", "a = 1", "a = 3", ())
    assert mutant.applied("a = 1\n") == "a = 3\n"
    with pytest.raises(ValueError, match=f"m: the text before occurs {times} times in f.py"):
        mutant.applied(text)


HOUSE = {
    "house.py": "def half(x):\n    return x / 2\n\n\ndef unseen():\n    return 1\n",
    "test_house.py": "import house\n\n\ndef test_half():\n    assert house.half(4) == 2\n",
    "test_wrong.py": "def test_wrong():\n    assert False\n",
}


@pytest.fixture
def house(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    # None is needed there, and they take seconds to load.
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    root = tmp_path / "house"
    root.mkdir()
    for name, text in HOUSE.items():
        (root / name).write_text(text)
    subprocess.run(["git", "init", "-q"], cwd=root, check=True)
    subprocess.run(["git", "add", "."], cwd=root, check=True)
    (root / "conftest.py").write_text("raise RuntimeError('it is not tracked')\n")
    return root


def list_of(folder: Path, *entries: tuple[str, str, str, str]) -> Path:
    path = folder / "mutants.toml"
    path.write_text(
        "".join(
            f'[[mutant]]\nname = "{name}"\nfile = "house.py"\nbefore = "{before}"\nafter = "{after}"\n'
            f'tests = ["{test}"]\n'
            for name, before, after, test in entries
        )
    )
    return path


@pytest.mark.slow
def test_what_lives_what_dies_and_what_cannot_be_tried(
    house: Path, tmp_path: Path, mutants: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    file = list_of(
        tmp_path,
        ("dead", "x / 2", "x / 3", "test_house.py"),
        ("crashed", "x / 2", "__import__('os').abort()", "test_house.py"),
        ("alive", "return 1", "return 2", "test_house.py::test_half"),
        ("lost", "x / 4", "x / 5", "test_house.py"),
        ("broken", "return x", "return x x", "test_house.py"),
    )
    assert mutants.main(["--jobs", "1"], house, file) == 1
    said = capsys.readouterr().out
    for name, verdict in (
        ("dead", "killed"), ("crashed", "killed"), ("alive", "SURVIVED"), ("lost", "DOES NOT APPLY"),
        ("broken", "CANNOT RUN"),
    ):  # fmt: skip
        assert re.search(rf"^{verdict} +[\d.]+ s  {name}$", said, re.M), said
    assert "2 of 5 mutants killed" in said
    assert (house / "house.py").read_text() == HOUSE["house.py"]
    assert mutants.main(["--jobs", "1", "--only", "dead"], house, file) == 0
    assert "1 of 1 mutants killed" in capsys.readouterr().out


def test_a_test_that_fails_anyway_kills_nothing(
    house: Path, tmp_path: Path, mutants: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    file = list_of(tmp_path, ("dead", "x / 2", "x / 3", "test_wrong.py"))
    assert mutants.main(["--jobs", "1"], house, file) == 1
    said = capsys.readouterr().out
    assert "do not pass without any mutant" in said
    assert "killed" not in said


def test_names_are_listed_and_an_unknown_one_is_refused(
    house: Path, tmp_path: Path, mutants: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    file = list_of(tmp_path, ("dead", "x / 2", "x / 3", "test_house.py"))
    assert mutants.main(["--list"], house, file) == 0
    assert capsys.readouterr().out.split() == ["dead", "house.py"]
    with pytest.raises(SystemExit) as stopped:
        mutants.main(["--only", "deaf"], house, file)
    assert stopped.value.code == 2


def test_tests_have_a_limit_of_time_for_each_of_them(
    mutants: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The tests of all mutants run first together, which takes longer than the tests of a single mutant may."""
    monkeypatch.setattr(mutants, "LONGEST", 0.001)
    assert mutants.run_tests(tmp_path, ["test_one.py"]) == (1, "not done after 0.001 s")
    assert mutants.run_tests(tmp_path, ["test_one.py", "test_other.py"]) == (1, "not done after 0.002 s")


@pytest.fixture(scope="module")
def sampling() -> ModuleType:
    return script("sample_mutants")


@pytest.mark.slow
def test_drawn_mutants_apply_are_python_and_are_the_same_for_a_seed(
    mutants: ModuleType, sampling: ModuleType, tmp_path: Path
) -> None:
    drawn = sampling.drawn(ROOT, 60, 3)
    (tmp_path / "sample.toml").write_text(sampling.toml(drawn))
    listed = mutants.listed(tmp_path / "sample.toml")
    assert len({mutant.name for mutant in listed}) == 60
    for mutant in listed:
        text = (ROOT / mutant.file).read_text()
        assert ast.dump(ast.parse(mutant.applied(text))) != ast.dump(ast.parse(text)), mutant
        assert mutant.tests
        assert all((ROOT / test).exists() for test in mutant.tests)
    assert drawn == sampling.drawn(ROOT, 60, 3)
    assert drawn != sampling.drawn(ROOT, 60, 4)


SOURCE = '''
LIMIT = 3

@cached(4)
def f(x: int = 5, y: "Float[Tensor, '6']" = None) -> float:
    """Text 7."""
    half: float = 0.5
    if x <= LIMIT and not y:
        raise ValueError(f"{x + 8} is too few")
    return max(x * half, -x) if x is not None else 2
'''


def test_bodies_are_changed_and_types_texts_and_errors_are_not(sampling: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "house.py").write_text(SOURCE)
    lines = SOURCE.splitlines()
    found = {
        (change.line, lines[change.line][change.begin : change.end], change.text)
        for change in sampling.places(tmp_path, "house")
    }
    assert found == {
        (6, "0.5", "1.0"), (7, "<=", "<"), (7, "and", "or"), (7, "not ", ""), (9, "*", "/"), (9, "-", ""),
        (9, "is not", "is"), (9, "2", "3"),
    }  # fmt: skip
