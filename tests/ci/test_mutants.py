"""The list of mutants is valid, and its check separates survivors from kills, on a house of one function."""

import ast
import re
import subprocess
from pathlib import Path
from types import ModuleType

import pytest

from ci_scripts import script

ROOT = Path(__file__).parents[2]
MOST_BY_HAND = 150


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


def test_names_are_names_and_few(mutants: ModuleType) -> None:
    names = [mutant.name for mutant in mutants.listed()]
    assert len(set(names)) == len(names)
    assert len(names) <= MOST_BY_HAND


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
def test_survivors_kills_and_untestable_mutants_are_told_apart(
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


def test_tests_that_do_not_end_count_as_failed(
    house: Path, tmp_path: Path, mutants: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    mutant = mutants.Mutant("endless", "house.py", "x / 2", "x", ("test_house.py",))
    with mutants.copies(house, 1) as folders:
        monkeypatch.setattr(mutants, "LONGEST", 0.001)
        assert mutants.tried(mutant, folders[0]).verdict == "killed"
        assert mutants.run_tests(folders[0], ["test_house.py"], seconds=0.001) == (None, "not done after 0.001 s")


@pytest.fixture(scope="module")
def sampling(mutants: ModuleType) -> ModuleType:
    return script("sample_mutants")


@pytest.mark.slow
def test_drawn_mutants_are_python_have_judges_and_are_the_same_for_a_seed(sampling: ModuleType) -> None:
    drawn = sampling.drawn(ROOT, 60, 3)
    assert len(drawn) == 60
    for mutant in drawn:
        if mutant.file.endswith(".py"):
            assert ast.dump(ast.parse(mutant.after)) != ast.dump(ast.parse(mutant.before)), mutant
        assert mutant.tests
        assert all((ROOT / test).exists() for test in mutant.tests)
        assert sampling.difference(mutant)
    assert drawn == sampling.drawn(ROOT, 60, 3)
    assert drawn != sampling.drawn(ROOT, 60, 4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "judge"),
    [
        ("radiogs_bench/scoring/metrics/albedo.py", "tests/metrics/test_albedo.py"),
        ("method/radiogs_core/kernels/image/similarity.py", "tests/method/core/kernels/test_image.py"),
        ("method/radiogs_core/kernels/shade/shade.inl", "tests/method/core/kernels/test_shade.py"),
        ("reports/radiogs_reports/page/script/browser.js", "tests/reports/page/test_page.py"),
    ],
)
def test_judges_are_the_tests_that_are_nearest(file: str, judge: str, judges: object) -> None:
    assert judge in judges.of(file)  # type: ignore[attr-defined]


@pytest.fixture(scope="module")
def judges(sampling: ModuleType) -> object:
    return sampling.Judges(ROOT)


SOURCE = '''
LIMIT = 3
small = 4

@cached(5)
def f(x: int = 6, y: "Float[Tensor, '7']" = None) -> float:
    """Text 8."""
    half: float = 0.5
    if x <= LIMIT and not y:
        raise ValueError(f"{x + 9} is too few")
    return g(x, -y, k=half * x)

def h(x: Box) -> None:
    """Fill it."""
    x.value = x.kept.detach() if x is not None else 2
    x.fill(
        [1] )
'''


def test_bodies_are_changed_and_types_texts_and_errors_are_not(sampling: ModuleType) -> None:
    text = SOURCE.encode()
    found = {
        (text.count(b"\n", 0, begin), text[begin:end].decode(), new)
        for begin, end, new in sampling.Python(text).places()
    }
    assert found == {
        (1, "3", "4"), (7, "0.5", "1.0"),
        (8, "x <= LIMIT and not y", "True"), (8, "x <= LIMIT and not y", "False"), (8, "and", "or"), (8, "<=", "<"),
        (8, "x <= LIMIT and not y", "(x <= LIMIT)"), (8, "x <= LIMIT and not y", "(not y)"), (8, "not y", "(y)"),
        (10, "g(x, -y, k=half * x)", "-(g(x, -y, k=half * x))"), (10, "g(x, -y, k=half * x)", "(x)"),
        (10, "x, -y", "-y, x"), (10, ", k=half * x", ""), (10, "-y", "(y)"), (10, "*", "/"), (10, "half * x", "(half)"),
        (10, "half * x", "(x)"),
        (14, "", "return\n    "), (14, "x.value = x.kept.detach() if x is not None else 2", "pass"),
        (14, "x is not None", "True"), (14, "x is not None", "False"), (14, "is not", "is"), (14, "2", "3"),
        (14, "x.kept.detach()", "x.kept"), (15, "x.fill(\n        [1] )", "pass"),
        (15, "x.fill(\n        [1] )", "([1])"), (16, "1", "2"),
    }  # fmt: skip


def test_native_text_is_changed_line_by_line(sampling: ModuleType) -> None:
    text = b"const Lanes* a = one - b * c; // d + e\nsum[0] += x < SCALAR(0.5) ? y : z;\n"
    found = {(text[begin:end].decode(), new) for begin, end, new in sampling.places_in_text(text)}
    assert found == {
        ("-", "+"), ("*", "/"), ("<", "<="), ("0.5", "1.0"), ("? y : z", "? z : y"),
    }  # fmt: skip
    assert [*sampling.places_in_text(b"  sum[0] += x;\n")] == [(2, 13, "")]


def test_survivors_are_printed_with_their_line_and_time_ends_the_draws(
    house: Path, sampling: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = HOUSE["house.py"]
    (house / "pyproject.toml").write_text("[tool.pytest.ini_options]\nmarkers = ['slow: slow']\n")
    subprocess.run(["git", "add", "pyproject.toml"], cwd=house, check=True)
    half, one = ((text.index(old), text.index(old) + 1, new) for old, new in (("2", "3"), ("1", "2")))
    made = [sampling.mutant_of(house, "house.py", place, ["test_house.py"]) for place in (half, one)]
    assert sampling.check(made, house, 1) == 1
    said = capsys.readouterr().out
    assert re.search(r"^killed +[\d.]+ s  house.py:2\nSURVIVED +[\d.]+ s  house.py:6\n", said), said
    assert said.endswith(
        "1 of 2 SURVIVED (2 drawn)\nhouse.py:6\n    -    return 1\n    +    return 2\n    judges: test_house.py\n"
    )
    wrong = sampling.mutant_of(house, "house.py", half, ["test_wrong.py"])
    assert sampling.check([wrong], house, 1) == 1
    assert "these tests fail without any mutant, too: nothing is shown" in capsys.readouterr().out
    monkeypatch.setattr(sampling, "WHOLE", 0.0)
    assert sampling.check(made, house, 1) == 0
    assert "0 of 0 SURVIVED (2 drawn)" in capsys.readouterr().out
