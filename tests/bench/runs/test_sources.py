"""Keys see every source that decides a value, found by following imports, and none that does not."""

import ast
import re
import shutil
from collections.abc import Mapping
from pathlib import Path

import pytest

from radiogs_bench import sources
from radiogs_bench.methods import budget_of, method, variant_of
from radiogs_bench.runs.cell import Work, cell_of
from radiogs_bench.sources import OURS, SourceTree, installed
from radiogs_bench.suites.experiment import AUDIT, COST, FORWARD_PARITY, STABILITY, TRAINING
from radiogs_core.scene.scene import Scene

BLENDER = Scene(
    "corner", "blender", (), (), {}, None, "0" * 64,
    loaders=("radiogs_datasets.layouts.blender",), surfaces_by=("radiogs_datasets.generate.surfaces",),
)  # fmt: skip
TENSOIR = Scene("hotdog", "tensoir", (), (), {}, None, "1" * 64, loaders=("radiogs_datasets.layouts.tensoir",))


def keys() -> dict[str, str]:
    """The keys of stages and results of every kind of cell, by what they name."""
    radiogs = method("radiogs")
    variant, budget = variant_of(radiogs, {}), budget_of(radiogs, "smoke")
    found = {}
    for name, scene, experiment in (
        ("training", BLENDER, TRAINING),
        ("elsewhere", TENSOIR, TRAINING),
        ("cost", BLENDER, COST),
        ("audit", BLENDER, AUDIT),
        ("parity", BLENDER, FORWARD_PARITY),
        ("stability", BLENDER, STABILITY),
    ):
        cell = cell_of(radiogs, scene, Work(variant, budget, experiment=experiment))
        found |= {f"{name}: {stage.name}": stage.key for stage in cell.stages} | {name: cell.key}
    return found


@pytest.fixture(scope="module")
def copies(tmp_path_factory: pytest.TempPathFactory) -> SourceTree:
    """Copies of all sources of the project, which a test may change."""
    folder = tmp_path_factory.mktemp("copies")
    python_alone = shutil.ignore_patterns("tiny", "forward", "vendor", "__pycache__")
    roots = installed().roots.items()
    return SourceTree({name: Path(shutil.copytree(root, folder / name, ignore=python_alone)) for name, root in roots})


def keys_from(tree: SourceTree) -> dict[str, str]:
    """The keys, were the project installed there."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sources, "installed", lambda *packages: tree)
        sources.code_digest.cache_clear()
        found = keys()
    sources.code_digest.cache_clear()
    return found


@pytest.fixture(scope="module")
def unchanged(copies: SourceTree) -> dict[str, str]:
    return keys_from(copies)


TRAINED = {"training", "elsewhere", "cost", "audit"}
FIRST = {f"{name}: initialise" for name in TRAINED}
SECOND = {f"{name}: invert" for name in TRAINED}
RESULTS = {*TRAINED, "parity", "stability"}

MODULES: Mapping[str, set[str]] = {
    # the kit: what is shared by all, and what the second stage alone uses
    "radiogs_core.kernels.rasterize.rasterize": FIRST | SECOND | RESULTS,
    "radiogs_core.transport.tracer": SECOND | {*TRAINED, "parity"},
    # RadioGS: stages, showing
    "radiogs.initialise": FIRST | SECOND | TRAINED,
    "radiogs.invert": SECOND | TRAINED,
    # Only a choice of effects trains by evidence; a model is shown by it in any case.
    "radiogs.effects.bounds": TRAINED | {"cost: invert"},
    # The model is shown by what metrics are computed with; a stage that is scored along the way is shown too.
    "radiogs.showing": TRAINED | {"cost: invert"},
    # loaders
    "radiogs_datasets.layouts.blender": (FIRST | SECOND | RESULTS) - {
        "elsewhere", "elsewhere: initialise", "elsewhere: invert",
    },
    "radiogs_datasets.layouts.tensoir": {"elsewhere", "elsewhere: initialise", "elsewhere: invert"},
    # the generator, where a suite uses its surfaces
    "radiogs_datasets.generate.surfaces": {"parity"},
    # the harness: metrics, what is scored along the way, experiments
    "radiogs_bench.scoring.metrics.psnr": RESULTS | {"cost: invert"},
    "radiogs_bench.runs.training_curves": {"cost: invert", "cost", "audit", "parity", "stability"},
    "radiogs_bench.runs.train": {"cost: invert", "cost", "audit"},
    "radiogs_bench.runs.forward_parity": {"parity"},
    # nothing that decides a value
    "radiogs_bench.cli.run": set(),
    "radiogs_bench.results.gate": set(),
    "radiogs_reports.summary": set(),
}  # fmt: skip
"""By module: the keys that one constant more in it changes."""


def keys_with(copies: SourceTree, module: str, file: Path, content: bytes) -> dict[str, str]:
    """The keys with another content of one file, by which ``module``'s digest may change."""
    whole = file.read_bytes()
    file.write_bytes(content)
    try:
        # Imports and digests of the other modules are not computed again: that takes most of the time.
        texts = {name: text for name, text in copies.known_texts.items() if name != module}
        digests = {name: digest for name, digest in copies.known_digests.items() if name != module}
        return keys_from(SourceTree(copies.roots, texts, dict(copies.known_imports), digests))
    finally:
        file.write_bytes(whole)


@pytest.mark.parametrize("module", MODULES)
def test_a_constant_changes_the_keys_of_what_it_decides_and_no_other(
    module: str, copies: SourceTree, unchanged: dict[str, str]
) -> None:
    path = copies.file(module)
    changed = keys_with(copies, module, path, path.read_bytes() + b"ONE_MORE = 1\n")
    assert {name for name in unchanged if unchanged[name] != changed[name]} == MODULES[module]


SHADED = "radiogs_core.kernels.shade.shade"


@pytest.mark.slow
def test_prose_and_layout_change_no_key(copies: SourceTree, unchanged: dict[str, str]) -> None:
    """In every module at once: a comment, a blank line, another docstring of the module, another width of lines."""
    reworded = {}
    for name, path in copies.closure(*OURS).items():
        tree = ast.parse(path.read_bytes())
        if tree.body and ast.get_docstring(tree) is not None:
            tree.body[0] = ast.Expr(ast.Constant(f"Another sentence on {name}."))
        reworded[path] = path.read_bytes()
        path.write_text(f"# What follows has no comments, and breaks its lines elsewhere.\n\n\n{ast.unparse(tree)}\n")
    try:
        assert keys_from(SourceTree(copies.roots)) == unchanged
    finally:
        for path, content in reworded.items():
            path.write_bytes(content)


def test_a_byte_of_a_loaded_data_file_changes_every_key_that_reaches_it_and_no_other(
    copies: SourceTree, unchanged: dict[str, str]
) -> None:
    file = next(path for path in copies.data_files(SHADED) if path.name == "shade.inl")
    changed = keys_with(copies, SHADED, file, file.read_bytes() + b" ")
    assert {name for name in unchanged if unchanged[name] != changed[name]} == FIRST | SECOND | RESULTS


def package(folder: Path, **texts: str) -> SourceTree:
    """A package ``own`` of modules with these texts."""
    root = folder / "own"
    for name, text in {"__init__": "", **texts}.items():
        path = root / f"{name.replace('__of__', '/')}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return SourceTree({"own": root})


def test_imports_are_followed_wherever_they_stand(tmp_path: Path) -> None:
    tree = package(
        tmp_path,
        top="import own.plain\nfrom . import sibling\nimport numpy\n",
        plain="def late():\n    from .deep import inner\n",
        sibling="from .plain import late\n",
        unused="",
    )
    (tmp_path / "own" / "deep").mkdir()
    (tmp_path / "own" / "deep" / "__init__.py").write_text("")
    (tmp_path / "own" / "deep" / "inner.py").write_text("")
    assert set(tree.closure("own.top")) == {"own", "own.top", "own.plain", "own.sibling", "own.deep", "own.deep.inner"}


def test_a_package_that_is_asked_for_counts_with_all_its_modules(tmp_path: Path) -> None:
    assert set(package(tmp_path, one="", two="").closure("own")) == {"own", "own.one", "own.two"}


def test_the_digest_sees_names_and_statements(tmp_path: Path) -> None:
    first = package(tmp_path / "first", one="x = 1\n").digest("own")
    assert package(tmp_path / "again", one="x = 1\n").digest("own") == first
    assert package(tmp_path / "named", two="x = 1\n").digest("own") != first


PROSE = ("# why\n{}", "{}\n\n\n", '"""A module."""\n{}', '{}\n"""What x is."""\n', "{}  # a remark\n")


@pytest.mark.parametrize("form", PROSE)
def test_prose_changes_no_digest(tmp_path: Path, form: str) -> None:
    code = "def f(a: int, *, b: str = 'c') -> list[int]:\n    x = [a, len(b)]\n    return x"
    wrapped = (
        'def f(\n    a: int, *, b: str = "c"\n) -> list[int]:\n    """Give two numbers."""\n'
        "    x = [\n        a,\n        len(b),\n    ]\n    return x"
    )
    first = package(tmp_path / "first", one=code).digest("own")
    assert package(tmp_path / "other", one=form.format(code)).digest("own") == first
    assert package(tmp_path / "wrapped", one=form.format(wrapped)).digest("own") == first


OTHERS = (
    "x = 1", "x = 2", "x = 1.0", "x = True", "x = '1'", "x = b'1'", "x = None", "x = -1", "x: int = 1", "y = 1",
    "x = 1, ", "x += 1", "x = 1\nx = 1", "if x: x = 1", "def x(): 1", "def x(): return 1", "def x(): return None",
    "'x = 1'",
    "x = {None: 1}", "x = {**1}", "x = f'{1}'", "x = f'{1!r}'", "x = f'{1:2}'", "lambda: 1", "async def x(): return 1",
    "match x:\n  case None: 1", "match x:\n  case True: 1", "from . import x", "from .. import x", "import x as y",
)  # fmt: skip


def test_every_other_statement_has_another_digest(tmp_path: Path) -> None:
    digests = [package(tmp_path / str(index), one=text).digest("own.one") for index, text in enumerate(OTHERS)]
    assert len(set(digests)) == len(OTHERS)


def test_data_files_that_a_module_names_count_with_their_bytes(tmp_path: Path) -> None:
    """Each way to name a file: whole, below a folder, by a pattern, with a hole."""
    ways = {
        "whole": "files(__package__) / 'table.npy'", "joined": "files(__package__).joinpath('deep', 'net.bin')",
        "below": "Path(__file__).parent / 'deep' / 'net.bin'", "pattern": "Path(__file__).parent.glob('deep/*.bin')",
        "everywhere": "Path(__file__).parent.rglob('*.bin')", "hole": "read(f'deep/{name}.bin')",
        "deep__of__above": "files('own') / 'table.npy'",
    }  # fmt: skip
    none = {"other": "read('missing.npy')", "code": "read('whole.py')", "above": "read('../outside.bin')"}
    none |= {"stars": "'deep/*.bin'", "elsewhere": "folder.rglob('*.bin')", "empty": "Path(__file__).parent.glob()"}
    none |= {"any": "f'{a}.{b}'", "long": repr("net.bin" * 100), "not_sound": "'a**.bin'", "prose": "'see table.npy'"}
    tree = package(tmp_path, **{name: f"x = {text}\n" for name, text in (ways | none).items()})
    (tmp_path / "outside.bin").write_bytes(b"0")
    (tmp_path / "own" / "table.npy").write_bytes(b"1")
    (tmp_path / "own" / "deep" / "net.bin").write_bytes(b"2")
    modules = {name: f"own.{name.replace('__of__', '.')}" for name in (*ways, *none)}
    before = {name: tree.digest(module) for name, module in modules.items()}
    table = ("whole", "deep__of__above")
    found = {name: [path.name for path in tree.data_files(module)] for name, module in modules.items()}
    assert found == {name: ["table.npy" if name in table else "net.bin"] for name in ways} | {name: [] for name in none}
    for path in ("outside.bin", "own/table.npy", "own/deep/net.bin"):
        (tmp_path / path).write_bytes(b"3")
    again = SourceTree(tree.roots)
    assert {name for name in before if again.digest(modules[name]) != before[name]} == set(ways)


def test_all_kernels_text_counts_for_the_module_that_loads_it() -> None:
    tree = installed()
    named = {path for module in tree.closure("radiogs_core") for path in tree.data_files(module)}
    assert set(tree.roots["radiogs_core"].rglob("*.inl")) == {p for p in named if p.suffix == ".inl"}


def test_a_module_in_no_package_has_no_data_files(tmp_path: Path) -> None:
    """Its folder is that of everything that is installed."""
    (tmp_path / "alone.py").write_text("x = Path(__file__).with_name('table.npy'), 'table.npy'\n")
    (tmp_path / "table.npy").touch()
    assert SourceTree({"alone": tmp_path / "alone.py"}).data_files("alone") == []


def test_a_module_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModuleNotFoundError, match=r"own\.missing"):
        package(tmp_path).closure("own.missing")


def test_no_source_that_decides_values_imports_by_a_computed_name() -> None:
    """Following the text would not see it. The registry of methods is the one place that loads by name."""
    tree = installed()
    deciding = tree.closure("radiogs", "radiogs_core", "radiogs_datasets", "radiogs_bench.scoring.evaluate")
    by_name = [
        name for name, path in deciding.items() if re.search(r"(import_module|resolve_name)\(", path.read_text())
    ]
    assert by_name == []
    assert set(OURS) <= set(tree.roots)


def test_a_package_without_an_init_file_is_followed_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "bare").mkdir()
    (tmp_path / "bare" / "method.py").write_text("from . import inner\n")
    (tmp_path / "bare" / "inner.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    assert set(installed("bare").closure("bare.method")) == {"bare.method", "bare.inner"}
