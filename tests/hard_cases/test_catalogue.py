"""The table of cases and the tests agree: nothing is listed that is not tested, nothing marked that is not listed."""

import ast
from collections import defaultdict
from pathlib import Path

from hard_cases.catalogue import CASES

TESTS = Path(__file__).parents[1]


def functions(file: Path) -> dict[str, ast.FunctionDef]:
    """Test functions of a file by name."""
    found = [node for node in ast.parse(file.read_text()).body if isinstance(node, ast.FunctionDef)]
    return {node.name: node for node in found if node.name.startswith("test_")}


def numbers(function: ast.FunctionDef) -> list[int]:
    """The cases that a test is marked with."""
    return [
        decorator.args[0].value  # type: ignore[attr-defined]
        for decorator in function.decorator_list
        if isinstance(decorator, ast.Call) and ast.unparse(decorator.func) == "pytest.mark.case"
    ]


def expected_failure(function: ast.FunctionDef) -> bool:
    return any(ast.unparse(decorator).startswith("pytest.mark.xfail(") for decorator in function.decorator_list)


def marked() -> dict[int, dict[str, list[ast.FunctionDef]]]:
    """Case to file to tests, over this folder."""
    found: dict[int, dict[str, list[ast.FunctionDef]]] = defaultdict(lambda: defaultdict(list))
    for file in sorted(Path(__file__).parent.glob("test_*.py")):
        for function in functions(file).values():
            for number in numbers(function):
                found[number][file.name].append(function)
    return found


def test_the_catalogue_counts_to_fifty_two_and_every_case_is_tested() -> None:
    assert [case.number for case in CASES] == list(range(1, 53))
    assert len({case.name for case in CASES}) == 52
    assert all(case.modules or case.elsewhere for case in CASES)


def test_marks_are_where_the_table_says_and_nowhere_else() -> None:
    found = marked()
    assert set(found) <= {case.number for case in CASES}
    for case in CASES:
        assert sorted(found[case.number]) == sorted(case.modules), f"case {case.number}, {case.name}"


def test_tests_that_stand_elsewhere_exist() -> None:
    for case in CASES:
        for place in case.elsewhere:
            file, name = place.split("::")
            assert name in functions(TESTS / file), f"case {case.number}: {place}"


def test_a_shortfall_is_an_expected_failure_and_every_expected_failure_a_shortfall() -> None:
    found = marked()
    for case in CASES:
        failing = any(expected_failure(test) for tests in found[case.number].values() for test in tests)
        assert failing == bool(case.shortfall), f"case {case.number}, {case.name}"


def test_every_test_of_a_hard_case_says_which() -> None:
    for file in sorted(Path(__file__).parent.glob("test_*.py")):
        if file.name == "test_catalogue.py":
            continue
        for name, function in functions(file).items():
            assert numbers(function), f"{file.name}::{name}"
