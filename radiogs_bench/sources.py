"""Digests of the code and data files that decide a result, found by following imports instead of a list; and the commit
of this package.

Every import in a module's text is followed, also inside functions, within the packages of this project and the
module's own (another package's method). Modules whose name is computed at run time are not seen.

Code counts as its statements: the syntax tree without docstrings, comments and layout. A reworded docstring changes no
digest, so that results stay valid. A data file counts with all its bytes for every module that names it in literals,
relative to its own folder or one around it in the package: ``files(__package__) / "tables" / "ggx.npy"``,
``f"{name}.npy"``, ``files(__package__).glob("*.npy")``.
"""

import ast
import hashlib
import json
import re
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import distribution
from importlib.util import find_spec
from pathlib import Path
from typing import NotRequired, TypedDict

OURS = ("radiogs_core", "radiogs", "radiogs_datasets", "radiogs_baselines", "radiogs_reports", "radiogs_bench")
"""Packages that imports are followed into, besides the requested module's own package."""


@dataclass(frozen=True)
class SourceTree:
    """The Python files of some top-level packages.

    ``roots``: the folder of each package, or the file of each module.
    """

    roots: Mapping[str, Path]
    known_texts: dict[str, "Text"] = field(default_factory=dict, repr=False, compare=False)
    """The modules that were read so far."""
    known_imports: dict[str, frozenset[str]] = field(default_factory=dict, repr=False, compare=False)
    """Imports of the modules that were read so far, as modules of the tree."""
    known_digests: dict[str, bytes] = field(default_factory=dict, repr=False, compare=False)
    """Digests of the modules that were read so far."""

    def file(self, module: str) -> Path | None:
        """The file of a module or package; None for any other name."""
        top, *rest = module.split(".")
        root = self.roots.get(top)
        if root is None:
            return None
        if root.is_file():
            return None if rest else root
        path = root.joinpath(*rest)
        if (path / "__init__.py").is_file():
            return path / "__init__.py"
        single = path.with_name(f"{path.name}.py")
        return single if rest and single.is_file() else None

    def closure(self, *modules: str) -> dict[str, Path]:
        """The modules, everything that they import within the tree, and the packages around all these, by name.

        A package that is asked for counts with all its modules. Raises ModuleNotFoundError for an unknown module.
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
        if module not in self.known_imports:
            found = (self._module_of(source, name) for source, name in self._text(module).imported)
            self.known_imports[module] = frozenset(each for each in found if each is not None)
        return self.known_imports[module]

    def data_files(self, module: str) -> list[Path]:
        """Files other than Python's that a module names in literals; none for one that is in no package."""
        path, top = self.file(module), self.roots[module.split(".")[0]]
        assert path is not None
        around = [folder for folder in path.parents if folder.is_relative_to(top)]
        patterns = self._text(module).patterns
        found = {file for folder in around for pattern in patterns for file in _matching(folder, pattern)}
        return sorted(file for file in found if file.suffix not in (".py", ".pyc"))

    def digest(self, *modules: str) -> str:
        """SHA-256 prefix over the closure's names, statements and data; the same wherever the packages are installed.

        The same, too, for every version of Python that reads the sources as the same syntax tree.
        """
        digest = hashlib.sha256()
        for name in self.closure(*modules):
            if name not in self.known_digests:
                self.known_digests[name] = self._digest(name)
            digest.update(f"{name}\0".encode() + self.known_digests[name])
        return digest.hexdigest()[:20]

    def _text(self, module: str) -> "Text":
        if module not in self.known_texts:
            path = self.file(module)
            assert path is not None
            self.known_texts[module] = _read(module, path)
        return self.known_texts[module]

    def _digest(self, module: str) -> bytes:
        """SHA-256 over a module's statements, and names and bytes of its data files."""
        digest = self._text(module).statements.copy()
        top = self.roots[module.split(".")[0]]
        for file in self.data_files(module):
            content = file.read_bytes()
            digest.update(f"\0{file.relative_to(top).as_posix()}\0{len(content)}\0".encode() + content)
        return digest.digest()

    def _module_of(self, source: str, name: str) -> str | None:
        """The module that a name is imported from: the name itself if it is a module."""
        inner = f"{source}.{name}" if name else source
        return inner if self.file(inner) is not None else source if self.file(source) is not None else None

    def _within(self, module: str) -> list[str]:
        path = self.file(module)
        if path is None or path.name != "__init__.py":
            return []
        inside = [each.relative_to(path.parent).with_suffix("") for each in path.parent.rglob("*.py")]
        return [".".join([module, *each.parts]) for each in inside if each.name != "__init__"]


@dataclass(frozen=True)
class Text:
    """The parts of a module's text that decide a digest; the syntax tree, which is large, is not kept."""

    imported: frozenset[tuple[str, str]]
    """Modules that it imports, and the names imported from them."""
    patterns: frozenset[str]
    """Paths of files that its literals name."""
    statements: "hashlib._Hash"
    """SHA-256 over its statements."""


def _read(module: str, path: Path) -> Text:
    tree = ast.parse(path.read_bytes(), path.as_posix())
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    imported: set[tuple[str, str]] = set()
    patterns: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            imported.update((alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")
            base = above[: len(above) - node.level + 1] if node.level else []
            source = ".".join([*base, *([node.module] if node.module else [])])
            imported.update((source, alias.name) for alias in node.names)
        elif isinstance(node, NAMING):
            patterns.add(_pattern(node))
    said: list[str] = []
    _state(tree, said)
    return Text(frozenset(imported), frozenset(patterns - {""}), hashlib.sha256("".join(said).encode()))


LAYOUT = frozenset({"ctx", "kind", "type_comment", "type_ignores"})
"""Fields of syntax nodes that follow from other fields or affect nothing."""


def _state(node: ast.AST, said: list[str]) -> None:
    """Append a syntax tree as text without positions, docstrings and other expression statements of strings.

    ``ast.dump`` differs between versions of Python: empty fields, which newer ones add, are left out here.
    """
    said.append(f"{type(node).__name__}(")
    for name in node._fields:
        value = getattr(node, name, None)
        if name in LAYOUT or value == [] or (value is None and not isinstance(node, ast.Constant)):
            continue
        said.append(f"{name}=")
        if isinstance(value, ast.AST):
            _state(value, said)
        elif isinstance(value, list):
            said.append("[")
            for each in value:
                alone = each.value if isinstance(each, ast.Expr) else None
                if not (isinstance(alone, ast.Constant) and isinstance(alone.value, str)):
                    _state(each, said) if isinstance(each, ast.AST) else said.append(repr(each))
            said.append("]")
        else:
            said.append(f"{type(value).__name__} {value!r}")
    said.append(")")


NAMING = (ast.Constant, ast.JoinedStr, ast.BinOp, ast.Call)
"""Nodes that may name a path."""


def _pattern(node: ast.AST) -> str:
    """The path that literals name, alone or joined, with ``*`` for computed parts; empty for any other node.

    A pattern of ``glob`` counts only in the module's own folder (``__file__``, ``__package__``).
    """
    if isinstance(node, ast.Constant):
        return "" if not isinstance(node.value, str) or "*" in node.value else _literal(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(_pattern(part) if isinstance(part, ast.Constant) else "*" for part in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
        return "/".join(filter(None, (_pattern(node.left), _pattern(node.right))))
    if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
        return ""
    method, folder, named = node.func.attr, node.func.value, node.args
    if method == "joinpath":
        return "/".join(filter(None, map(_pattern, (folder, *named))))
    own = any(isinstance(each, ast.Name) and each.id in OWN for each in ast.walk(folder))
    if method in ("glob", "rglob") and own and named and isinstance(named[0], ast.Constant):
        below = ["**"] if method == "rglob" else []
        return "/".join(filter(None, (_pattern(folder), *below, _literal(str(named[0].value)))))
    return ""


OWN = ("__file__", "__package__", "__name__")
"""Names by which a module finds its own folder."""


def _literal(text: str) -> str:
    """A literal as a pattern in which only stars match other characters; empty if it cannot be a file name."""
    return re.sub(r"([?\[])", r"[\1]", text) if len(text) <= LONGEST_NAME and "\n" not in text else ""


LONGEST_NAME = 200
"""Characters of the longest literal that can be a file name."""


def _matching(folder: Path, pattern: str) -> Iterator[Path]:
    parts = pattern.split("/")
    below = not pattern.startswith("/") and ".." not in parts
    sound = all("**" not in part or part == "**" for part in parts)  # pathlib refuses others
    stem, _, suffix = parts[-1].rpartition(".")
    if below and sound and stem and suffix and "*" not in suffix:
        yield from (path for path in folder.glob(pattern) if path.is_file())


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
    """Digest of the modules' installed sources, imports and data files; cached for the life of the process."""
    return installed(*sorted({module.split(".")[0] for module in modules} - set(OURS))).digest(*modules)


class GitState(TypedDict):
    """The state of a repository."""

    commit: str
    dirty: NotRequired[bool]
    """Whether files differ from the commit; absent where pip installed the commit."""


@cache
def git_state(folder: Path = Path(__file__).parent) -> GitState | None:
    """Commit and dirtiness of the repository that tracks this package, else the commit that pip installed it from.

    None if neither knows one, as for a wheel, or git is missing.
    """

    def git(*arguments: str) -> str | None:
        try:
            done = subprocess.run(["git", *arguments], cwd=folder, capture_output=True, text=True, check=False)
        except FileNotFoundError:
            return None
        return done.stdout.strip() if done.returncode == 0 else None

    tracked = git("ls-files", "--error-unmatch", "__init__.py") is not None
    if tracked and (commit := git("rev-parse", "HEAD")) is not None:
        return {"commit": commit, "dirty": git("status", "--porcelain") != ""}
    installed_from = json.loads(distribution("radiogs-bench").read_text("direct_url.json") or "{}")
    commit = installed_from.get("vcs_info", {}).get("commit_id")
    return None if commit is None else {"commit": commit}


def version_and_commit() -> str:
    """The version, and the commit if it is known: ``0.1.0, commit 0123456789ab, with changes``."""
    number, state = distribution("radiogs-bench").version, git_state()
    known = "unknown" if state is None else f"{state['commit'][:12]}{', with changes' if state.get('dirty') else ''}"
    return f"{number}, commit {known}"
