"""Draws single-line mutants at random, as a list that ``mutants.py`` takes.

    python .ci/sample_mutants.py COUNT [--seed N] > sample.toml
    python .ci/mutants.py --file sample.toml

Rooms are drawn in proportion to the places in them that can be changed. A place is an operator, a comparison, a number,
a truth value, a ``not`` or a minus sign of a function's body; types, texts and what is only said in errors stay. The
tests of a mutant are those files that import its module, then all of its room, until the first one fails.
"""

import argparse
import ast
import random
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]

ROOMS: Mapping[str, Sequence[str]] = {
    "method/radiogs_core": ("tests/method/core",),
    "method/radiogs": ("tests/method/radiogs",),
    "radiogs_bench/scoring/metrics": ("tests/metrics",),
    "radiogs_bench/store": (
        "tests/bench/store/test_store.py", "tests/bench/store/test_seals.py", "tests/bench/runs/engines/test_engine.py",
        "tests/bench/results/test_verify.py", "tests/bench/attacks/test_ends.py", "tests/bench/export/test_export.py",
        "tests/bench/runs/test_sweep.py", "tests/bench/store/test_provenance.py",
    ),
    "reports/radiogs_reports/statistics": ("tests/reports",),
    "datasets/radiogs_datasets": ("tests/datasets",),
}  # fmt: skip
"""Sources, and the tests of their room."""

LEFT_OUT = ("datasets/radiogs_datasets/generate/", "datasets/radiogs_datasets/blend/")
"""They render with programs that are not installed everywhere, and without these their tests skip."""

OTHER = {
    ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*"), ast.FloorDiv: ("//", "*"),
    ast.Mod: ("%", "//"), ast.Lt: ("<", "<="), ast.LtE: ("<=", "<"), ast.Gt: (">", ">="), ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="), ast.NotEq: ("!=", "=="), ast.And: ("and", "or"), ast.Or: ("or", "and"),
    ast.Is: ("is", "is not"), ast.IsNot: ("is not", "is"), ast.In: ("in", "not in"), ast.NotIn: ("not in", "in"),
}  # fmt: skip
"""An operator and what takes its place."""


@dataclass(frozen=True)
class Change:
    """One place in a file: its line and columns from 0, and the text that takes its place."""

    file: str
    line: int
    begin: int
    end: int
    text: str


class Places(ast.NodeVisitor):
    """Changes within the bodies of functions."""

    def __init__(self, file: str, lines: Sequence[str]) -> None:
        self.file, self.lines, self.found = file, lines, list[Change]()
        self.depth = 0

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        """Its body, without decorators, defaults and types."""
        self.depth += 1
        for statement in node.body:
            self.visit(statement)
        self.depth -= 1

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        """The value without the type."""
        if node.value is not None:
            self.visit(node.value)

    def visit_Raise(self, node: ast.Raise) -> None:
        """Leave the texts of errors unchanged."""

    def visit_Assert(self, node: ast.Assert) -> None:
        """Nor what is checked for the type checker."""

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """Nor texts."""

    def visit_BinOp(self, node: ast.BinOp) -> None:
        """An arithmetic operator."""
        self._between(node.left, node.right, node.op)
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        """The first of some equal operators of logic."""
        self._between(node.values[0], node.values[1], node.op)
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        """The first comparison of a chain."""
        self._between(node.left, node.comparators[0], node.ops[0])
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        """A ``not`` or a minus sign, which goes."""
        length = {ast.Not: len("not"), ast.USub: len("-")}.get(type(node.op))
        if length is not None:
            rest = self.lines[node.lineno - 1].encode()[node.col_offset + length :]
            spaces = len(rest) - len(rest.lstrip())
            self._add(node.lineno, node.col_offset, node.col_offset + length + spaces, "")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        """A number one more or twice as large, or the other truth value."""
        value = node.value
        if isinstance(value, bool):
            self._constant(node, str(not value))
        elif isinstance(value, int):
            self._constant(node, str(value + 1))
        elif isinstance(value, float):
            self._constant(node, repr(2 * value if value else 1.0))

    def _constant(self, node: ast.Constant, text: str) -> None:
        if node.end_col_offset is not None:
            self._add(node.lineno, node.col_offset, node.end_col_offset, text)

    def _between(self, left: ast.expr, right: ast.expr, operator: ast.AST) -> None:
        known = OTHER.get(type(operator))  # type: ignore[call-overload]
        if known is None or left.end_lineno != right.lineno or left.end_col_offset is None:
            return
        gap = self.lines[right.lineno - 1].encode()[left.end_col_offset : right.col_offset].decode()
        place = re.search(rf"(?<![\w*/<>=!]){re.escape(known[0])}(?![\w*/=])", gap)
        if place is not None:
            begin = left.end_col_offset + len(gap[: place.start()].encode())
            self._add(right.lineno, begin, begin + len(known[0]), known[1])

    def _add(self, line: int, begin: int, end: int, text: str) -> None:
        if self.depth:
            self.found.append(Change(self.file, line - 1, begin, end, text))


def places(root: Path, room: str) -> Iterator[Change]:
    """Every change in a room's sources, in the order of files and lines."""
    sources = sorted((root / room).rglob("*.py")) if (root / room).is_dir() else [root / f"{room}.py"]
    for path in sources:
        file = path.relative_to(root).as_posix()
        if not file.startswith(LEFT_OUT):
            visitor = Places(file, (text := path.read_text()).splitlines())
            visitor.visit(ast.parse(text))
            yield from visitor.found


def as_mutant(root: Path, change: Change, tests: Sequence[str]) -> dict[str, object]:
    """The change as an entry of the list: with as many lines before it as make its text unique in the file."""
    text = (root / change.file).read_text()
    lines = text.splitlines()
    line = lines[change.line].encode()
    new = (line[: change.begin] + change.text.encode() + line[change.end :]).decode()
    first = change.line
    while first and text.count("\n".join(lines[first : change.line + 1])) > 1:
        first -= 1
    context = lines[first : change.line]
    return {
        "name": f"{change.file}:{change.line + 1}: {new.strip()}",
        "file": change.file,
        "before": "\n".join([*context, lines[change.line]]),
        "after": "\n".join([*context, new]),
        "tests": [*importers(root, change.file, tests), *tests],
    }


def importers(root: Path, file: str, tests: Sequence[str]) -> list[str]:
    """Test files of the room that import the module of a file."""
    module = file.removesuffix(".py").partition("/")[2].replace("/", ".")
    module = module if file.startswith(("method/", "datasets/", "reports/")) else f"radiogs_bench.{module}"
    package, _, name = module.rpartition(".")
    wanted = re.compile(rf"from {re.escape(module)} import|from {re.escape(package)} import .*\b{name}\b")
    files = [
        path for room in tests for path in ([root / room] if room.endswith(".py") else (root / room).rglob("test_*.py"))
    ]
    return sorted(path.relative_to(root).as_posix() for path in files if wanted.search(path.read_text()))


def drawn(root: Path, count: int, seed: int, rooms: Mapping[str, Sequence[str]] = ROOMS) -> list[dict[str, object]]:
    """``count`` mutants without repetition."""
    every = [(change, tests) for room, tests in rooms.items() for change in places(root, room)]
    chosen = random.Random(seed).sample(every, min(count, len(every)))
    return [as_mutant(root, change, tests) for change, tests in chosen]


def toml(mutants: Sequence[Mapping[str, object]]) -> str:
    """The list as a file."""

    def value(given: object) -> str:
        if isinstance(given, list):
            return f"[{', '.join(map(value, given))}]"
        escaped = str(given).replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
        return f'"{escaped}"'

    return "\n".join(
        "[[mutant]]\n" + "".join(f"{name} = {value(given)}\n" for name, given in mutant.items()) for mutant in mutants
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("count", type=int)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(arguments)
    sys.stdout.write(toml(drawn(ROOT, given.count, given.seed)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
