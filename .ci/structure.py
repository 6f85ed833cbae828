"""What import-linter and ruff do not say of the house: no circle of rooms, no long function, no crowd of parameters.

    python .ci/structure.py

A room is a folder of modules. Two rooms that import each other, directly or around, are a circle; a module counts for
the room that it lies in. Exit code 1 with every finding on a line.
"""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCES = {
    "radiogs_core": "method",
    "radiogs": "method",
    "radiogs_datasets": "datasets",
    "radiogs_baselines": "baselines",
    "radiogs_reports": "reports",
    "radiogs_bench": ".",
}

LONGEST_FUNCTION = 60
MOST_PARAMETERS = 7
KERNELS = ("radiogs_core.kernels", "radiogs_bench.kernel_bench.plain", "radiogs_datasets.generate.disney_bsdf")
"""Kernels, their plain counterparts, and the class that Mitsuba wants made after a variant is chosen: one parameter for
each array, and a factory that holds every function of its kind."""

REGISTRATION = "radiogs_bench.methods"
"""Nothing above the kit may import RadioGS: its entry point registers it."""

Modules = dict[str, ast.Module]


def modules() -> Modules:
    """Every module of the project by its name."""
    found = {}
    for package, source in SOURCES.items():
        top = ROOT / source
        for path in sorted((top / package).rglob("*.py")):
            parts = path.relative_to(top).with_suffix("").parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            found[name] = ast.parse(path.read_bytes(), str(path))
    return found


def imports(name: str, tree: ast.Module, known: Modules) -> Iterator[str]:
    """Modules of the project that a module imports, wherever in its text."""
    package = name if _is_package(name, known) else name.rpartition(".")[0]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")
            base = above[: len(above) - node.level + 1] if node.level else []
            source = ".".join([*base, *([node.module] if node.module else [])])
            for alias in node.names:
                target = f"{source}.{alias.name}"
                if target in known or source in known:
                    yield target if target in known else source


def _is_package(name: str, known: Modules) -> bool:
    return any(other.startswith(f"{name}.") for other in known)


def room(name: str, known: Modules) -> str:
    """The folder that a module lies in, as a dotted name."""
    return name if _is_package(name, known) else name.rpartition(".")[0]


def circles(known: Modules) -> list[list[str]]:
    """Sets of rooms that import one another in a circle; a room and the rooms within it are no circle."""
    arrows: dict[str, set[str]] = {}
    for name, tree in known.items():
        here = room(name, known)
        for target in imports(name, tree, known):
            there = room(target, known)
            inside = there.startswith(f"{here}.") or here.startswith(f"{there}.")
            if there != here and not inside:
                arrows.setdefault(here, set()).add(there)
    return [sorted(group) for group in _strongly_connected(arrows) if len(group) > 1]


def _strongly_connected(arrows: dict[str, set[str]]) -> Iterator[set[str]]:
    """Tarjan's algorithm."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []

    def visit(node: str) -> Iterator[set[str]]:
        index[node] = low[node] = len(index)
        stack.append(node)
        for target in sorted(arrows.get(node, ())):
            if target not in index:
                yield from visit(target)
                low[node] = min(low[node], low[target])
            elif target in stack:
                low[node] = min(low[node], index[target])
        if low[node] == index[node]:
            place = stack.index(node)
            group = set(stack[place:])
            del stack[place:]
            yield group

    for node in sorted(arrows):
        if node not in index:
            yield from visit(node)


def crowded(name: str, tree: ast.Module) -> Iterator[str]:
    """Functions that are too long or take too many parameters."""
    if name.startswith(KERNELS):
        return
    for node in ast.walk(tree):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        lines = (node.end_lineno or node.lineno) - node.lineno + 1
        given = [each.arg for each in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
        count = len([each for each in given if each not in ("self", "cls")])
        if lines > LONGEST_FUNCTION:
            yield f"{name}:{node.lineno} {node.name}: {lines} lines (at most {LONGEST_FUNCTION})"
        if count > MOST_PARAMETERS:
            yield f"{name}:{node.lineno} {node.name}: {count} parameters (at most {MOST_PARAMETERS})"


def strangers(known: Modules) -> Iterator[str]:
    """Modules above the kit that import RadioGS itself."""
    for name, tree in known.items():
        if name.split(".")[0] not in ("radiogs", REGISTRATION):
            for target in imports(name, tree, known):
                if target.split(".")[0] == "radiogs":
                    yield f"{name} imports {target}: the harness knows methods by their contract"


def main() -> int:
    """Print every finding; 1 if there is any."""
    known = modules()
    findings = [f"circle of rooms: {' <-> '.join(circle)}" for circle in circles(known)]
    findings += [line for name, tree in known.items() for line in crowded(name, tree)]
    findings += sorted(set(strangers(known)))
    sys.stdout.writelines(f"{line}\n" for line in [*findings, f"{len(known)} modules, {len(findings)} findings"])
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
