"""Digests of the sources that decide a result, found by following imports, so that no list has to be kept.

Every import in a module's text is followed, also inside functions, within the packages of this project and the
module's own (another package's method). Modules whose name is computed at run time are not seen.
"""

import ast
import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.util import find_spec
from pathlib import Path

OURS = ("radiogs_core", "radiogs", "radiogs_datasets", "radiogs_baselines", "radiogs_reports", "radiogs_bench")
"""Packages that imports are followed into, besides that of the requested module."""


@dataclass(frozen=True)
class SourceTree:
    """The Python files of some top-level packages.

    ``roots`` says where each package (its folder) or module (its file) lies.
    """

    roots: Mapping[str, Path]
    _imports: dict[str, frozenset[str]] = field(default_factory=dict, repr=False, compare=False)

    def file(self, module: str) -> Path | None:
        """The file of a module or package; None for what is no module of these packages."""
        top, *rest = module.split(".")
        root = self.roots.get(top)
        if root is None:
            return None
        if root.is_file():
            return None if rest else root
        place = root.joinpath(*rest)
        if (place / "__init__.py").is_file():
            return place / "__init__.py"
        single = place.with_name(f"{place.name}.py")
        return single if rest and single.is_file() else None

    def closure(self, *modules: str) -> dict[str, Path]:
        """The modules, everything that they import within the tree, and the packages around all these, by name.

        A package that is asked for counts with all its modules. Raises ModuleNotFoundError for what is not there.
        """
        waiting = []
        for module in modules:
            if self.file(module) is None:
                raise ModuleNotFoundError(f"no module '{module}'")
            waiting += [module, *self._within(module)]
        followed: set[str] = set()
        while waiting:
            module = waiting.pop()
            if module not in followed:
                followed.add(module)
                waiting += self.imports(module)
        # Importing a module runs the packages around it; what those import for others decides nothing here.
        around = {
            ".".join(module.split(".")[:depth]) for module in followed for depth in range(1, module.count(".") + 1)
        }
        found = {module: self.file(module) for module in sorted(followed | around)}
        return {module: path for module, path in found.items() if path is not None}

    def imports(self, module: str) -> frozenset[str]:
        """Modules of the tree that a module imports, anywhere in its text."""
        if module not in self._imports:
            path = self.file(module)
            assert path is not None
            package = module if path.name == "__init__.py" else module.rpartition(".")[0]
            tree = ast.parse(path.read_bytes(), path.as_posix())
            named = (name for node in ast.walk(tree) for name in _imported(node, package))
            found = (self._module_of(source, name) for source, name in named)
            self._imports[module] = frozenset(each for each in found if each is not None)
        return self._imports[module]

    def digest(self, *modules: str) -> str:
        """SHA-256 prefix over names and bytes of the closure; independent of where the packages are installed."""
        digest = hashlib.sha256()
        for name, path in self.closure(*modules).items():
            content = path.read_bytes()
            digest.update(f"{name}\0{len(content)}\0".encode() + content)
        return digest.hexdigest()[:20]

    def _module_of(self, source: str, name: str) -> str | None:
        """The module that a name is taken from: itself, if it is one."""
        inner = f"{source}.{name}" if name else source
        return inner if self.file(inner) is not None else source if self.file(source) is not None else None

    def _within(self, module: str) -> list[str]:
        path = self.file(module)
        if path is None or path.name != "__init__.py":
            return []
        inside = [each.relative_to(path.parent).with_suffix("") for each in path.parent.rglob("*.py")]
        return [".".join([module, *each.parts]) for each in inside if each.name != "__init__"]


def _imported(node: ast.AST, package: str) -> Iterator[tuple[str, str]]:
    """Imports of a statement: modules, and the names imported from them, which may be modules too."""
    if isinstance(node, ast.Import):
        yield from ((alias.name, "") for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        above = package.split(".")
        base = above[: len(above) - node.level + 1] if node.level else []
        source = ".".join([*base, *([node.module] if node.module else [])])
        yield from ((source, alias.name) for alias in node.names)


def _place(package: str) -> Path:
    spec = find_spec(package)
    if spec is not None and spec.origin is None and spec.submodule_search_locations:
        return Path(next(iter(spec.submodule_search_locations)))  # a package without __init__.py
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError(f"no module '{package}'")
    origin = Path(spec.origin)
    return origin.parent if origin.name == "__init__.py" else origin


@cache
def installed(*packages: str) -> SourceTree:
    """The tree of this project's packages and of others that are named, as they are installed."""
    return SourceTree({package: _place(package) for package in dict.fromkeys((*OURS, *packages))})


@cache
def code_digest(*modules: str) -> str:
    """Digest of the modules' installed sources and their imports; cached for the life of the process."""
    return installed(*sorted({module.split(".")[0] for module in modules} - set(OURS))).digest(*modules)
