"""Breaks single places of the sources at random and prints those that no test notices.

    python .ci/sample_mutants.py [COUNT] [--seed N] [--jobs N]

A place is drawn from all packages, kernels' C++ and the page's scripts included; types, texts of errors and programs
that few have (LEFT_OUT) stay. A mutant has an operator, a number, a truth value or a condition changed, an operand, a
call, a keyword, a statement or a minus sign dropped, two arguments exchanged, or a function that returns at once. The
judges are the test files that are nearest to the module by imports, until the first test fails; a test that skips
itself notices nothing, so run ``make extras`` before. After LONGEST seconds a mutant is undecided, and after WHOLE
seconds none is begun. Tests that failed run once more without any mutant: with one that fails anyway, nothing is
shown. Exit status 1 if a mutant survives or nothing is shown.
"""

import argparse
import ast
import difflib
import random
import re
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from mutants import Mutant, Outcome, copies, in_parallel, mutated, outcomes, run_tests, say

from radiogs_bench.sources import OURS, SourceTree

ROOT = Path(__file__).parents[1]
COUNT = 100
LONGEST = 75.0
WHOLE = 1080.0
"""Seconds: of the twenty minutes that a run may take, the rest is for the tests that failed."""

MOST_JUDGES = 10
"""Files of tests of a mutant, the nearest ones."""

FOLDERS = {
    "radiogs_core": "method", "radiogs": "method", "radiogs_datasets": "datasets", "radiogs_baselines": "baselines",
    "radiogs_reports": "reports", "radiogs_bench": ".",
}  # fmt: skip
"""Packages and their source roots."""

LEFT_OUT = ("datasets/radiogs_datasets/generate/", "datasets/radiogs_datasets/blend/", "vendor/")
"""They render with programs that are not installed everywhere, and without these their tests skip; or are not ours."""

Place = tuple[int, int, str]
"""Where a text begins and ends, in bytes of its file, and what takes its place."""

OTHER = {
    ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*"), ast.FloorDiv: ("//", "*"),
    ast.Mod: ("%", "//"), ast.Lt: ("<", "<="), ast.LtE: ("<=", "<"), ast.Gt: (">", ">="), ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="), ast.NotEq: ("!=", "=="), ast.And: ("and", "or"), ast.Or: ("or", "and"),
    ast.Is: ("is", "is not"), ast.IsNot: ("is not", "is"), ast.In: ("in", "not in"), ast.NotIn: ("not in", "in"),
}  # fmt: skip
"""An operator and what takes its place."""

ELEMENTWISE = {"abs", "clamp", "conj", "cumsum", "detach", "exp", "log", "masked_fill", "sqrt", "square"}
"""Methods of tensors whose result may take the place of its receiver."""

IN_TEXT = {"+": "-", "-": "+", "*": "/", "<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "==",
           "&": "|", "|": "&", "&&": "||", "||": "&&", "===": "!==", "!==": "==="}  # fmt: skip
"""The same for C++ and JavaScript, where they stand between spaces."""

NUMERIC = ("float", "Float[", "Tensor")
"""How types begin whose values have a sign."""


class Python:
    """Places in the text of a module: bodies of functions, and numbers that have a name of capitals."""

    def __init__(self, text: bytes) -> None:
        self.text = text
        self.lines = [0, *(place.end() for place in re.finditer(b"\n", text))]

    def places(self) -> Iterator[Place]:
        """All of them, in the order of the text."""
        for node in ast.walk(ast.parse(self.text)):
            if isinstance(node, ast.FunctionDef):
                yield from self._of_function(node)
        for node in ast.parse(self.text).body:
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id.isupper():
                yield from self._of_expression(node.value)

    def _of_function(self, node: ast.FunctionDef) -> Iterator[Place]:
        returns = ast.unparse(node.returns) if node.returns is not None else ""
        body = node.body[1:] if ast.get_docstring(node) is not None else node.body
        if returns == "None" and body:
            begin = self._begin(body[0])
            yield begin, begin, f"return\n{' ' * body[0].col_offset}"
        for statement in body:
            yield from self._of_statement(statement, returns)

    def _of_statement(self, node: ast.AST, returns: str) -> Iterator[Place]:
        """Its own, and those of what it holds; functions within are walked by themselves."""
        if isinstance(node, ast.Raise | ast.Assert | ast.JoinedStr | ast.FunctionDef):
            return
        if isinstance(node, ast.Return) and node.value is not None and returns.startswith(NUMERIC):
            yield self._replaced(node.value, f"-({self._of(node.value)})")
        if isinstance(node, ast.AugAssign | ast.Delete) or (
            isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
        ):
            yield self._replaced(node, "pass")
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Attribute | ast.Subscript):
            yield self._replaced(node, "pass")
        for test in (*([node.test] if isinstance(node, ast.If | ast.IfExp) else []), *getattr(node, "ifs", ())):
            yield from (self._replaced(test, value) for value in ("True", "False"))
        if isinstance(node, ast.expr):
            yield from self._of_expression(node)
        for name, inner in ast.iter_fields(node):
            for each in inner if isinstance(inner, list) else [inner]:
                if isinstance(each, ast.AST) and name != "annotation":
                    yield from self._of_statement(each, returns)

    def _of_expression(self, node: ast.expr) -> Iterator[Place]:
        match node:
            case ast.BinOp(left=left, op=op, right=right):
                yield from self._operator(left, op, right)
                yield self._replaced(node, f"({self._of(left)})")
                if isinstance(op, ast.Mult | ast.Add):
                    yield self._replaced(node, f"({self._of(right)})")
            case ast.BoolOp(op=op, values=[first, *_, last]):
                yield from self._operator(first, op, node.values[1])
                yield from (self._replaced(node, f"({self._of(one)})") for one in (first, last))
            case ast.Compare(left=left, ops=[op, *_], comparators=[right, *_]):
                yield from self._operator(left, op, right)
            case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
                yield self._replaced(node, f"({self._of(operand)})")
            case ast.Constant(value=bool(value)):
                yield self._replaced(node, str(not value))
            case ast.Constant(value=int(value)):
                yield self._replaced(node, str(value + 1))
            case ast.Constant(value=float(value)):
                yield self._replaced(node, repr(2 * value if value else 1.0))
            case ast.Call():
                yield from self._of_call(node)

    def _of_call(self, node: ast.Call) -> Iterator[Place]:
        if isinstance(node.func, ast.Attribute) and node.func.attr in ELEMENTWISE:
            yield self._replaced(node, self._of(node.func.value))
        elif node.args and not isinstance(node.args[0], ast.Starred | ast.GeneratorExp):
            yield self._replaced(node, f"({self._of(node.args[0])})")
        if len(node.args) > 1 and not any(isinstance(each, ast.Starred) for each in node.args[:2]):
            first, second = node.args[:2]
            between = self.text[self._end(first) : self._begin(second)].decode()
            yield self._begin(first), self._end(second), f"{self._of(second)}{between}{self._of(first)}"
        given = sorted([*node.args, *node.keywords], key=self._begin)
        for before, each in pairwise(given):
            if isinstance(each, ast.keyword):
                yield self._end(before), self._end(each), ""

    def _operator(self, left: ast.expr, operator: ast.AST, right: ast.expr) -> Iterator[Place]:
        old, new = OTHER.get(type(operator), ("", ""))  # type: ignore[call-overload]
        gap = self.text[self._end(left) : self._begin(right)].decode()
        if old and (place := re.search(rf"(?<![\w*/<>=!]){re.escape(old)}(?![\w*/=])", gap)):
            begin = self._end(left) + len(gap[: place.start()].encode())
            yield begin, begin + len(old), new

    def _begin(self, node: ast.expr | ast.stmt | ast.keyword) -> int:
        return self.lines[node.lineno - 1] + node.col_offset

    def _end(self, node: ast.expr | ast.stmt | ast.keyword) -> int:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return self.lines[node.end_lineno - 1] + node.end_col_offset

    def _of(self, node: ast.expr) -> str:
        return self.text[self._begin(node) : self._end(node)].decode()

    def _replaced(self, node: ast.expr | ast.stmt, text: str) -> Place:
        return self._begin(node), self._end(node), text


def places_in_text(text: bytes) -> Iterator[Place]:
    """Places in C++ or JavaScript, found line by line: operators, numbers, choices and statements that add up."""
    begin = 0
    for line in text.splitlines(keepends=True):
        code = line.partition(b"//")[0].decode("latin-1")
        for place in re.finditer(r"(?<= )([-+*<>&|=!]{1,3})(?= )", code):
            if place[0] in IN_TEXT:
                yield begin + place.start(), begin + place.end(), IN_TEXT[place[0]]
        for place in re.finditer(r"\bSCALAR\((\d[\d.]*)\)", code):
            yield begin + place.start(1), begin + place.end(1), repr(2 * float(place[1]) or 1.0)
        for place in re.finditer(r"\? ([^?:;]+) : ([^?:;]+)(?=[;,)])", code):
            yield begin + place.start(), begin + place.end(), f"? {place[2]} : {place[1]}"
        for place in re.finditer(r"(?<=[ ;])[\w.\[\]]+ [-+*|&]= [^;]+(?=;)", code):
            yield begin + place.start(), begin + place.end(), ""
        begin += len(line)


def places_of(path: Path) -> Iterator[Place]:
    """The places of a source file."""
    text = path.read_bytes()
    return Python(text).places() if path.suffix == ".py" else places_in_text(text)


def mutant_of(root: Path, file: str, place: Place, judges: Sequence[str]) -> Mutant:
    """The change of a place. The whole text of the file is the text that it replaces."""
    text = (root / file).read_bytes()
    begin, end, new = place
    changed = (text[:begin] + new.encode() + text[end:]).decode()
    line = text.count(b"\n", 0, begin) + 1
    return Mutant(f"{file}:{line}", file, text.decode(), changed, tuple(judges))


def difference(mutant: Mutant) -> list[str]:
    """The lines that a mutant takes away and adds."""
    lines = difflib.unified_diff(mutant.before.splitlines(), mutant.after.splitlines(), n=0, lineterm="")
    return [f"    {line}" for line in [*lines][2:] if not line.startswith("@@")]


class Judges:
    """Test files by the number of imports between them and a module."""

    def __init__(self, root: Path) -> None:
        self.root = root
        tests = root / "tests"
        helpers = {path.stem: path for path in tests.iterdir() if path.is_dir() or path.suffix == ".py"}
        packages = {name: root / folder / name for name, folder in FOLDERS.items()}
        self.tree = SourceTree(packages | helpers)
        paths = [*tests.rglob("*.py"), *(path for name in OURS for path in packages[name].rglob("*.py"))]
        self.names = {path: self._name(path) for path in paths}
        self.users: dict[str, set[str]] = {}
        for name in self.names.values():
            for imported in self.tree.imports(name):
                self.users.setdefault(imported, set()).add(name)

    def of(self, file: str) -> tuple[str, ...]:
        """The nearest MOST_JUDGES test files of a source file (from the root); where several are equally near, those
        whose paths have words of its path come first."""
        path = self.root / file
        name = self.names.get(path, "")
        reached = [name] if name in self.users else self._readers(path)
        words = {*Path(file).with_suffix("").parts}
        paths, seen, found = {name: path for path, name in self.names.items()}, {*reached}, list[str]()
        while reached and len(found) < MOST_JUDGES:
            tests = [paths[name] for name in reached if paths[name].name.startswith("test_")]
            tests.sort(key=lambda test: (-len(words & {*test.parts, test.stem.removeprefix("test_")}), test.as_posix()))
            found += [test.relative_to(self.root).as_posix() for test in tests]
            reached = sorted({user for name in reached for user in self.users.get(name, ())} - seen)
            seen |= {*reached}
        return tuple(found[:MOST_JUDGES])

    def _readers(self, path: Path) -> list[str]:
        """Modules that name a data file, such as kernels' C++; else, as for a command, those of its folder or above."""
        named = [name for each, name in self.names.items() if path.is_relative_to(each.parent)]
        named = [name for name in named if path in self.tree.data_files(name)]
        near = (path.parent, path.parents[1])
        return sorted(named or (name for each, name in self.names.items() if each.parent in near))

    def _name(self, path: Path) -> str:
        top = next(folder for folder in self.tree.roots.values() if path.is_relative_to(folder))
        parts = path.relative_to(top.parent).with_suffix("").parts
        return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def drawn(root: Path, count: int, seed: int) -> list[Mutant]:
    """``count`` mutants without repetition, of places that some test is near to."""
    paths = [path for name, folder in FOLDERS.items() for path in (root / folder / name).rglob("*.*")]
    files = sorted(path.relative_to(root).as_posix() for path in paths if path.suffix in (".py", ".inl", ".js"))
    every = [
        (file, place)
        for file in files
        if not any(part in file for part in LEFT_OUT)
        for place in places_of(root / file)
    ]
    judges = Judges(root)
    chosen = random.Random(seed).sample(every, min(count, len(every)))
    return [mutant_of(root, file, place, judges.of(file)) for file, place in chosen]


def tried(mutant: Mutant, folder: Path, *, until: float) -> Outcome:
    """The judges' verdict; none once time is over (``until``, of the monotonic clock)."""
    begun = time.monotonic()
    if begun >= until:
        return Outcome(mutant, "not begun", 0.0)
    with mutated(mutant, folder):
        status, output = run_tests(folder, mutant.tests, "-x", "-m", "not slow", seconds=LONGEST)
    verdicts: Mapping[int | None, str] = {0: "SURVIVED", 5: "SURVIVED", None: "undecided"}
    return Outcome(mutant, verdicts.get(status, "killed"), time.monotonic() - begun, output)


def killers(outcome: Outcome) -> set[str]:
    """Tests that failed, by pytest's last lines; the nearest file where none was reached."""
    failed = re.findall(r"^FAILED (\S+?::.+?)(?: - .*)?$", outcome.output, re.MULTILINE)
    return {*failed} or {*outcome.mutant.tests[:1]}


def check(mutants: Sequence[Mutant], root: Path, jobs: int) -> int:
    """Try as many as time allows, print the verdicts and what survives, and return the exit status."""
    found = []
    with copies(root, jobs) as folders:
        outcome: Callable[[Mutant, Path], Outcome] = partial(tried, until=time.monotonic() + WHOLE)
        for each in outcomes(mutants, folders, outcome):
            if each.verdict != "not begun":
                found.append(each)
                say(f"{each.verdict:9} {each.seconds:6.1f} s  {each.mutant.name}")
        failed = sorted({test for each in found if each.verdict == "killed" for test in killers(each)})
        options = (*in_parallel(jobs), "-m", "not slow")
        status, output = run_tests(folders[0], failed, *options, seconds=WHOLE) if failed else (0, "")
    for verdict in ("undecided", "SURVIVED"):
        of_kind = [each.mutant for each in found if each.verdict == verdict]
        say(f"{len(of_kind)} of {len(found)} {verdict} ({len(mutants)} drawn)")
        for mutant in of_kind:
            say(mutant.name, *difference(mutant), f"    judges: {' '.join(mutant.tests)}")
    if status != 0:
        say(output, "these tests fail without any mutant, too: nothing is shown")
    return 1 if status != 0 or any(each.verdict == "SURVIVED" for each in found) else 0


def main(arguments: Sequence[str] | None = None, root: Path = ROOT) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("count", type=int, nargs="?", default=COUNT, help=f"mutants (default: {COUNT})")
    parser.add_argument("--seed", type=int, default=int(time.time()), help="of the draw (default: another each time)")
    parser.add_argument("--jobs", type=int, default=2, help="how many at a time (default: 2)")
    given = parser.parse_args(arguments)
    say(f"seed {given.seed}")
    return check(drawn(root, given.count, given.seed), root, max(1, given.jobs))


if __name__ == "__main__":
    sys.exit(main())
