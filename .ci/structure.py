"""Checks the structure that import-linter and ruff do not see: circles, sizes of folders, and the number of pieces.

    python .ci/structure.py

A room is a folder of modules; a module counts for the room that it lies in. Neither rooms nor files import each other
in a circle. A folder holds between FEWEST and MOST files (``__init__.py`` and data apart; kernels' C++ counts; a folder
of tests has no least number), a function has a bounded length and number of parameters, and the whole stays within
LIMITS. No test module imports another one, and no test uses a private name of ours. Prints the counts, and every
finding on a line; exit code 1 if there is any.
"""

import ast
import sys
from collections.abc import Iterable, Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from radiogs_bench.sources import OURS, SourceTree, installed

TESTS = Path(__file__).parents[1] / "tests"

FUNCTIONS = ast.FunctionDef | ast.AsyncFunctionDef

BY_NAME = {"setattr", "getattr", "delattr", "object"}
"""Functions that take an attribute's name as text; ``object`` is that of ``unittest.mock.patch``."""

LONGEST_FUNCTION = 60
LONG_FUNCTION = 26
"""Lines from which a function counts as long: 5 % of them at most are."""

MOST_PARAMETERS = 7
KERNELS = ("radiogs_core.kernels", "radiogs_bench.lab.kernels.plain", "radiogs_datasets.generate.disney_bsdf")
"""Kernels, their plain counterparts, and the class that Mitsuba wants made after a variant is chosen: one parameter for
each array, and a factory that holds every function of its kind."""

FEWEST, MOST = 5, 30
"""Files of a folder: with fewer it hides nothing, with more nobody finds a thing in it."""

HARNESS = "radiogs_bench"

LIMITS: Mapping[str, int] = {
    "product files": 549,
    "files with one user": 88,
    "arrows between folders of the harness": 61,
    "long functions of a thousand": 50,
    "lines of radiogs_core": 12_720, "functions of radiogs_core": 740,
    "lines of radiogs": 4_829, "functions of radiogs": 260,
    "lines of radiogs_datasets": 12_218, "functions of radiogs_datasets": 654,
    "lines of radiogs_baselines": 8_553, "functions of radiogs_baselines": 485,
    "lines of radiogs_reports": 8_678, "functions of radiogs_reports": 514,
    "lines of radiogs_bench": 25_986, "functions of radiogs_bench": 1_433,
    "lines of kernels' C++": 3_824,
    "lines of the page's JavaScript": 1_806,
    "lines of tests": 63_531,
}  # fmt: skip
"""The most that there may be; lower a number once there is less. A file that one other imports belongs into that one,
unless readers look for it by its own name. On 2026-11-30 some bounds rose: of datasets with the kinds of photos,
masks, names and splits that captures by others have, and with their check in one pass; of JavaScript, reports and the
harness with relighting in the page; of the kit and the harness with lamps and starts from splats; of datasets with
poses of photographs; of the harness with textured meshes and published sites; of reports with a contact sheet of every
model; of tests with all."""

TABLES = (
    "radiogs_bench.scoring.metrics.measures",
    "radiogs_bench.suites.registry",
    "radiogs_datasets.deep_check",
    "radiogs_datasets.registry",
    "radiogs_reports.run_folder",
)
"""Files that list what there is: measures, suites, deep checks, layouts, reports. An entry is a file of its
own, and a new one is a file and a line: these are not counted as files with one user."""

METHOD = "radiogs"
"""Nothing outside may import RadioGS: its entry point registers it."""


def room(tree: SourceTree, module: str) -> str:
    """The folder that a module lies in, as a dotted name."""
    path = tree.file(module)
    return module if path is not None and path.name == "__init__.py" else module.rpartition(".")[0]


def circles(tree: SourceTree, modules: list[str]) -> Iterator[str]:
    """One circle of rooms and one of files, if there is any; a room and the rooms within it are no circle.

    Imports within functions count.
    """
    files = {name: tree.imports(name) - {name} for name in modules}
    rooms: dict[str, set[str]] = {}
    for name, targets in files.items():
        here = room(tree, name)
        for there in (room(tree, target) for target in targets):
            inside = there.startswith(f"{here}.") or here.startswith(f"{there}.")
            if there != here and not inside:
                rooms.setdefault(here, set()).add(there)
    for what, arrows in (("rooms", rooms), ("files", files)):
        try:
            TopologicalSorter(arrows).prepare()
        except CycleError as error:
            yield f"circle of {what}: {' <-> '.join(sorted({*error.args[1]}))}"


def sizes_of_folders(tree: SourceTree, modules: list[str]) -> Iterator[str]:
    """Folders of modules that hold too few or too many files."""
    folders = {path.parent for name in modules if (path := tree.file(name)) and path.name != "__init__.py"}
    for folder in sorted(folders):
        files = [each for suffix in ("py", "inl") for each in folder.glob(f"*.{suffix}") if each.name != "__init__.py"]
        if not FEWEST <= len(files) <= MOST:
            yield f"{folder.parent.name}/{folder.name}: {len(files)} files ({FEWEST} to {MOST})"


def sizes_of_test_folders(tests: Path) -> Iterator[str]:
    """Folders of tests that hold too many files, helpers included."""
    for folder in sorted({path.parent for path in tests.rglob("*.py")}):
        files = [each for each in folder.glob("*.py") if each.name != "__init__.py"]
        if len(files) > MOST:
            yield f"{folder.relative_to(tests.parent).as_posix()}: {len(files)} files (at most {MOST})"


def with_one_user(tree: SourceTree, modules: list[str]) -> dict[str, str]:
    """The files that exactly one other file imports, and that file; without entries of TABLES and ``__init__.py``."""
    users: dict[str, set[str]] = {}
    for name in modules:
        for target in tree.imports(name) - {name}:
            if room(tree, target) != target:
                users.setdefault(target, set()).add(name)
    return {name: next(iter(using)) for name, using in users.items() if len(using) == 1 and not using & {*TABLES}}


def arrows(tree: SourceTree, modules: list[str]) -> int:
    """How many pairs of the harness's folders have an import from one to the other."""
    ours = [name for name in modules if name.split(".")[0] == HARNESS]
    pairs = {
        (room(tree, name), room(tree, target))
        for name in ours
        for target in tree.imports(name)
        if target.split(".")[0] == HARNESS
    }
    return len([1 for here, there in pairs if here != there])


def lines_in(folders: Iterable[Path], suffix: str) -> int:
    """Lines of the files with a suffix, without what others wrote (``vendor``)."""
    files = {path for folder in folders for path in folder.rglob(f"*{suffix}") if "vendor" not in path.parts}
    return sum(len(path.read_bytes().splitlines()) for path in files)


def functions_in(folder: Path) -> list[int]:
    """Lines of each function of a package, those within functions and classes included."""
    nodes = [node for path in folder.rglob("*.py") for node in ast.walk(ast.parse(path.read_bytes()))]
    return [length(node) for node in nodes if isinstance(node, FUNCTIONS)]


def length(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Lines of a function, from its ``def`` on."""
    return (node.end_lineno or node.lineno) - node.lineno + 1


def counts(tree: SourceTree, modules: list[str], tests: Path) -> dict[str, int]:
    """How many pieces there are, by the names of LIMITS."""
    functions = {name: functions_in(folder) for name, folder in tree.roots.items()}
    every = [lines for each in functions.values() for lines in each]
    of_packages = {}
    for name, folder in tree.roots.items():
        of_packages |= {f"lines of {name}": lines_in([folder], ".py"), f"functions of {name}": len(functions[name])}
    return {
        "product files": len(modules),
        "files with one user": len(with_one_user(tree, modules)),
        "arrows between folders of the harness": arrows(tree, modules),
        "long functions of a thousand": -(-1000 * sum(lines >= LONG_FUNCTION for lines in every) // max(1, len(every))),
        **of_packages,
        "lines of kernels' C++": lines_in(tree.roots.values(), ".inl"),
        "lines of the page's JavaScript": lines_in(tree.roots.values(), ".js"),
        "lines of tests": lines_in([tests], ".py"),
    }


def crowded(tree: SourceTree, module: str) -> Iterator[str]:
    """Functions that are too long or take too many parameters."""
    path = tree.file(module)
    if path is None or module.startswith(KERNELS):
        return
    for node in ast.walk(ast.parse(path.read_bytes())):
        if not isinstance(node, FUNCTIONS):
            continue
        lines = length(node)
        given = [each.arg for each in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
        count = len([each for each in given if each not in ("self", "cls")])
        if lines > LONGEST_FUNCTION:
            yield f"{module}:{node.lineno} {node.name}: {lines} lines (at most {LONGEST_FUNCTION})"
        if count > MOST_PARAMETERS:
            yield f"{module}:{node.lineno} {node.name}: {count} parameters (at most {MOST_PARAMETERS})"


def strangers(tree: SourceTree, module: str) -> Iterator[str]:
    """Imports of RadioGS from outside."""
    if module.split(".")[0] != METHOD:
        for target in sorted(tree.imports(module)):
            if target.split(".")[0] == METHOD:
                yield f"{module} imports {target}: the harness knows methods by their contract"


def private_names(tree: SourceTree, modules: list[str]) -> set[str]:
    """Functions, classes, variables and attributes that begin with one underscore."""
    names = set()
    for path in filter(None, map(tree.file, modules)):
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                names.add(node.name)
            elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
                names.add(node.id if isinstance(node, ast.Name) else node.attr)
    return {name for name in names if name.strip("_") and name.startswith("_") and not name.startswith("__")}


def reached(node: ast.AST, private: set[str]) -> Iterator[str]:
    """Test modules that a node imports, and private names that it uses other than on ``self`` and ``cls``."""
    if isinstance(node, ast.Import | ast.ImportFrom):
        before = (node.module or "").split(".") if isinstance(node, ast.ImportFrom) else []
        for alias in node.names:
            parts = [*before, *alias.name.split(".")]
            yield from (f"imports {part}" for part in parts if part.startswith("test_"))
            if parts[0] in OURS and alias.name in private:
                yield f"imports {alias.name}"
    elif isinstance(node, ast.Attribute) and node.attr in private:
        if not (isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")):
            yield f"uses {node.attr}"
    elif isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) in BY_NAME:
        named = [each.value for each in node.args if isinstance(each, ast.Constant)]
        yield from (f"uses {name}" for name in named if name in private)


def reaching(folder: Path, private: set[str]) -> Iterator[str]:
    """Tests that import other test modules, or that use private names."""
    for path in sorted(folder.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_bytes())):
            for what in reached(node, private):
                yield f"{path.relative_to(folder.parent)}:{getattr(node, 'lineno', 0)} {what}"


def findings(tree: SourceTree, *packages: str) -> list[str]:
    """Everything that is wrong with the modules of some packages, a line each, but for the limits of the whole."""
    modules = list(tree.closure(*packages))
    each = [line for name in modules for line in (*crowded(tree, name), *strangers(tree, name))]
    return [*circles(tree, modules), *sizes_of_folders(tree, modules), *each]


def main() -> int:
    """Print the counts and every finding; 1 if there is any."""
    tree = installed()
    counted = counts(tree, list(tree.closure(*OURS)), TESTS)
    private = private_names(tree, list(tree.closure(*OURS)))
    beyond = [f"{name}: more than {LIMITS[name]}" for name, number in counted.items() if number > LIMITS[name]]
    found = [*findings(tree, *OURS), *sizes_of_test_folders(TESTS), *beyond, *reaching(TESTS, private)]
    shown = [f"{number} {name} (at most {LIMITS[name]})" for name, number in counted.items()]
    sys.stdout.writelines(f"{line}\n" for line in [*shown, *found, f"{len(found)} findings"])
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
