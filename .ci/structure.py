"""What import-linter and ruff do not say of the house: no circle of rooms, no long function, no crowd of parameters.

    python .ci/structure.py

A room is a folder of modules. Two rooms that import each other, directly or around, are a circle; a module counts for
the room that it lies in. Exit code 1 with every finding on a line.
"""

import ast
import sys
from collections.abc import Iterator

from radiogs_bench.sources import OURS, SourceTree, installed

LONGEST_FUNCTION = 60
MOST_PARAMETERS = 7
KERNELS = ("radiogs_core.kernels", "radiogs_bench.lab.kernels.plain", "radiogs_datasets.generate.disney_bsdf")
"""Kernels, their plain counterparts, and the class that Mitsuba wants made after a variant is chosen: one parameter for
each array, and a factory that holds every function of its kind."""

METHOD = "radiogs"
"""Nothing outside may import RadioGS: its entry point registers it."""


def room(tree: SourceTree, module: str) -> str:
    """The folder that a module lies in, as a dotted name."""
    path = tree.file(module)
    return module if path is not None and path.name == "__init__.py" else module.rpartition(".")[0]


def circles(tree: SourceTree, modules: list[str]) -> Iterator[str]:
    """Sets of rooms that import one another in a circle; a room and the rooms within it are no circle."""
    arrows: dict[str, set[str]] = {}
    for name in modules:
        here = room(tree, name)
        for there in (room(tree, target) for target in tree.imports(name)):
            inside = there.startswith(f"{here}.") or here.startswith(f"{there}.")
            if there != here and not inside:
                arrows.setdefault(here, set()).add(there)
    reached = {start: _reached(arrows, start) for start in arrows}
    found = {frozenset(other for other in reached[start] if start in reached.get(other, ())) for start in arrows}
    for circle in sorted(found, key=sorted):
        if circle:
            yield f"circle of rooms: {' <-> '.join(sorted(circle))}"


def _reached(arrows: dict[str, set[str]], start: str) -> set[str]:
    """The rooms that arrows lead to, ``start`` itself only by way of others."""
    found: set[str] = set()
    waiting = [start]
    while waiting:
        fresh = arrows.get(waiting.pop(), set()) - found
        found |= fresh
        waiting += fresh
    return found


def crowded(tree: SourceTree, module: str) -> Iterator[str]:
    """Functions that are too long or take too many parameters."""
    path = tree.file(module)
    if path is None or module.startswith(KERNELS):
        return
    for node in ast.walk(ast.parse(path.read_bytes())):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        lines = (node.end_lineno or node.lineno) - node.lineno + 1
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


def findings(tree: SourceTree, *packages: str) -> list[str]:
    """Everything that is wrong with the modules of some packages, a line each."""
    modules = list(tree.closure(*packages))
    each = [line for name in modules for line in (*crowded(tree, name), *strangers(tree, name))]
    return [*circles(tree, modules), *each]


def main() -> int:
    """Print every finding; 1 if there is any."""
    found = findings(installed(), *OURS)
    sys.stdout.writelines(f"{line}\n" for line in [*found, f"{len(found)} findings"])
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
