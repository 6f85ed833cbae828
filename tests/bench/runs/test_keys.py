"""Keys change with everything that decides a product, also with every source, and with nothing else."""

import ast
import dataclasses
import json
import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from bench.chain_method import Chain, Steps, Turned
from bench.fake_method import FAKE, SCENE, fake_cell
from radiogs.method import RADIOGS
from radiogs.settings import DEVIATIONS, INVERSE_ONLY, PRESETS, Budget, Variant
from radiogs_bench import sources
from radiogs_bench.methods import budget_of, method, variant_of
from radiogs_bench.runs.cell import Cell, Work, cell_of, evaluation_code
from radiogs_bench.sources import OURS, SourceTree, installed
from radiogs_bench.store.keys import content_key
from radiogs_bench.suites.experiment import AUDIT, COST, EXPERIMENTS, FORWARD_PARITY, STABILITY, TRAINING
from radiogs_bench.suites.paper import ABLATIONS
from radiogs_core.contract import StageSpec, values_of
from radiogs_core.plain_values import flat, with_values
from radiogs_core.scene.scene import Scene

OTHER_VALUES: Mapping[str, Any] = {
    "radiometric_weight": 0.1,
    "detach": "pbr",
    "initialise": "nvs",
    "view_share": 0.5,
    "shading": "split-sum",
    "incident": "detached",
    "relighting": "surfels",
    "met_light": "unoccluded",
    "deviations": tuple(DEVIATIONS),
    "ray_offset": 0.1,
    "masking": "height-correlated",
    "effects": "auto",
    "given": ("light",),
    "geometry": replace(Variant().geometry, weights=replace(Variant().geometry.weights, normal=0.1)),
    "split_sum": replace(Variant().split_sum, consistency=0.1),
    "materials": replace(Variant().materials, weights=replace(Variant().materials.weights, mask=0.1)),
    "finetuning": replace(Variant().finetuning, degree_0=0.1),
}
"""Another value of every field of the variant than the full method has."""

FROM_STAGE_1 = ("initialise", "view_share", "deviations", "geometry", "split_sum", "masking")
SHOWING_ALONE = ("relighting", "met_light", "finetuning")


def radiogs_cell(variant: Variant | None = None, budget: Budget | None = None, **work: Any) -> Cell:
    """A cell of the method itself."""
    return cell_of(RADIOGS, SCENE, Work(variant or Variant(), budget or PRESETS["smoke"], **work))


def changed(cell: Cell, like: Cell) -> list[bool]:
    """Which keys differ: one for each stage, then the result's."""
    stages = [mine.key != theirs.key for mine, theirs in zip(cell.stages, like.stages, strict=True)]
    return [*stages, cell.key != like.key]


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(Variant)])
def test_a_field_of_the_variant_changes_the_first_stage_that_reads_it_and_all_after(name: str) -> None:
    first = 0 if name in FROM_STAGE_1 else 2 if name in SHOWING_ALONE else 1
    found = changed(radiogs_cell(Variant(**{name: OTHER_VALUES[name]})), radiogs_cell())
    assert found == [place >= first for place in range(3)]


@pytest.mark.parametrize("name", flat(dataclasses.asdict(PRESETS["smoke"])))
def test_a_field_of_the_budget_changes_the_first_stage_that_reads_it_and_all_after(name: str) -> None:
    """The budget's name belongs to no stage's work: a preset under another name trains the same."""
    first = 2 if name in ("name", *Budget.shown_only) else 1 if name in INVERSE_ONLY else 0
    smoke = PRESETS["smoke"]
    value = "other" if name == "name" else 2 * flat(dataclasses.asdict(smoke))[name]
    found = changed(radiogs_cell(budget=with_values(smoke, {name: value})), radiogs_cell())
    assert found == [place >= first for place in range(3)]


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(Variant)])
def test_the_start_of_stage_2_is_shared_by_variants_that_differ_in_what_it_does_not_read(name: str) -> None:
    start = radiogs_cell(Variant(**{name: OTHER_VALUES[name]})).stages[1].start
    assert (start != radiogs_cell().stages[1].start) == (name in (*FROM_STAGE_1, "shading", "effects"))


def test_the_ablations_of_radiometric_consistency_share_the_start_of_stage_2_but_for_the_other_stage_1() -> None:
    rows = {row.key: radiogs_cell(Variant(**row.variant)).stages[1].start for row in ABLATIONS.rows}
    assert [key for key, start in rows.items() if start != rows["ours"]] == ["nvs-init"]


def test_deviations_that_stage_1_does_not_make_leave_it_shared() -> None:
    later = next(
        name for name in DEVIATIONS if name not in Variant(deviations=(name,)).of_initialisation()["deviations"]
    )
    assert changed(radiogs_cell(Variant(deviations=(later,))), radiogs_cell()) == [False, True, True]


@pytest.mark.parametrize(
    "other",
    [
        fake_cell(scene=replace(SCENE, checksum="1" * 64)),
        fake_cell(scene=replace(SCENE, loaders=("radiogs_core.errors",))),
        fake_cell(seed=1),
        fake_cell(device="cuda"),
    ],
    ids=["scene", "loader", "seed", "device"],
)
def test_every_key_depends_on_scene_loader_seed_and_device(other: Cell) -> None:
    assert changed(other, fake_cell()) == [True, True, True]


@dataclass(frozen=True)
class Differently:
    """The fake with something else in the stages from ``place`` on, or in how it is shown."""

    place: int = 0
    change: tuple[tuple[str, Any], ...] = ()
    sources: tuple[str, ...] = FAKE.sources

    name = FAKE.name
    title = FAKE.title
    variant = FAKE.variant
    presets = FAKE.presets
    restore = FAKE.restore

    def stages(self, variant: Variant, budget: Budget) -> Sequence[StageSpec]:
        specs = list(FAKE.stages(variant, budget))
        specs[self.place] = replace(specs[self.place], **dict(self.change))
        return specs


def differently(*given: Any, **named: Any) -> Cell:
    return cell_of(Differently(*given, **named), SCENE, Work(Variant(), PRESETS["smoke"]))


@pytest.mark.parametrize("place", [0, 1])
@pytest.mark.parametrize(
    "change",
    [("owner", "another"), ("name", "another"), ("reads", {"other": 1}), ("sources", ("radiogs_core.scene.camera",))],
)
def test_owner_name_dependencies_and_sources_of_a_stage_change_it_and_all_after(place: int, change: Any) -> None:
    assert changed(differently(place, (change,)), fake_cell()) == [stage >= place for stage in range(3)]


@pytest.mark.parametrize("change", [("title", "another"), ("steps", 99), ("compiles", False)])
def test_the_title_of_a_stage_changes_no_key(change: Any) -> None:
    """Steps are among what it reads if they decide its outcome."""
    assert changed(differently(0, (change,)), fake_cell()) == [False] * 3


def test_sources_of_showing_change_the_result_and_train_nothing_anew() -> None:
    found = differently(sources=("radiogs.relighting",))
    assert changed(found, fake_cell()) == [False, False, True]
    assert found.evaluation_code != fake_cell().evaluation_code
    assert found.method_code != fake_cell().method_code


class Siblings(Chain):
    """A chain that shares its first stages with another method."""

    def stages(self, variant: Turned, budget: Steps) -> Sequence[StageSpec]:
        first, *rest = super().stages(variant, budget)
        return [replace(first, owner="elder"), *rest]


def test_methods_that_name_one_owner_share_a_stage_and_no_more() -> None:
    work = Work(Turned(), Chain.presets["smoke"])
    elder = cell_of(Chain(("begin", "end"), name="elder"), SCENE, work)
    younger = cell_of(Siblings(("begin", "end"), name="younger"), SCENE, work)
    assert changed(younger, elder) == [False, True, True]


def test_a_field_that_only_rendering_reads_changes_the_result_and_no_stage() -> None:
    chain = Chain(("one", "two", "three"))
    cells = [cell_of(chain, SCENE, Work(Turned(shown=shown), chain.presets["smoke"])) for shown in (1.0, 2.0)]
    assert changed(*cells) == [False, False, False, True]


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_stages_are_chained_with_a_first_and_a_last_key(count: int) -> None:
    """Stages that read and do the same are still different products, one after the other."""

    class Alike(Chain):
        def stages(self, variant: Turned, budget: Steps) -> Sequence[StageSpec]:
            return [
                replace(spec, name="again", reads=values_of(variant, "weight"))
                for spec in super().stages(variant, budget)
            ]

    cell = cell_of(Alike([f"s{place}" for place in range(count)]), SCENE, Work(Turned(), Alike.presets["smoke"]))
    keys = [stage.key for stage in cell.stages]
    assert len({*keys, cell.key}) == count + 1
    assert (cell.first_key, cell.training_key) == (keys[0], keys[-1])


def test_an_experiment_that_trains_nothing_has_no_stages_and_is_its_own_first() -> None:
    cell = fake_cell(experiment=FORWARD_PARITY, settings={"spacing": 0.1})
    assert cell.stages == ()
    assert cell.training_key is None
    assert cell.first_key == cell.key
    assert cell.key != fake_cell(experiment=FORWARD_PARITY, settings={"spacing": 0.2}).key


def test_another_protocol_keeps_the_trained_model() -> None:
    assert changed(fake_cell(protocol="irgs"), fake_cell()) == [False, False, True]


def test_other_sources_that_score_keep_the_trained_model() -> None:
    other = replace(fake_cell(), evaluation_code="other")
    assert changed(other, fake_cell()) == [False, False, True]


def test_scores_during_training_are_part_of_the_last_stages_product() -> None:
    assert changed(fake_cell(experiment=COST), fake_cell()) == [False, True, True]
    assert changed(fake_cell(experiment=COST, protocol="irgs"), fake_cell(experiment=COST)) == [False, True, True]


def test_the_scene_counts_by_its_content_not_by_its_name() -> None:
    assert changed(fake_cell(scene=replace(SCENE, name="elsewhere/corner")), fake_cell()) == [False] * 3


def test_the_key_depends_on_the_method_and_not_on_its_path() -> None:
    work = Work(Variant(), PRESETS["smoke"])
    found = cell_of(FAKE, SCENE, work, "somewhere/fake.toml")
    assert found.found_as == "somewhere/fake.toml"
    assert changed(found, fake_cell()) == [False] * 3


def test_every_field_of_the_variant_is_in_the_content() -> None:
    assert fake_cell().content()["variant"].keys() == {field.name for field in dataclasses.fields(Variant)}


@pytest.mark.parametrize("variant", [Variant(deviations=tuple(DEVIATIONS)), Variant(effects=("visibility",))])
def test_a_stored_result_returns_the_content_of_its_cell(variant: Variant) -> None:
    """Otherwise nothing would be found in a store by its content."""
    content = fake_cell(variant=variant).content()
    assert json.loads(json.dumps(content)) == content


def test_tuples_of_a_strangers_budget_are_lists_in_the_content() -> None:
    content = cell_of(Chain(("fit",)), SCENE, Work(Turned(), Chain.presets["smoke"])).content()
    assert content["budget"] == {"name": "smoke", "each": 3, "sizes": [8, 4]}
    assert json.loads(json.dumps(content)) == content


def test_keys_are_the_same_in_every_process_and_forever() -> None:
    """A literal: if this fails, every store in the world is out of date, and the schema's version must rise."""
    content = {"b": [1, 2.5, None, True], "a": {"text": "Ä"}}
    # printf '%s' '{"a":{"text":"\\u00c4"},"b":[1,2.5,null,true]}' | sha256sum
    assert content_key(content) == "edea64a45ce29f8f2855"


def test_content_that_is_no_json_has_no_key() -> None:
    with pytest.raises(ValueError, match="Out of range"):
        content_key({"value": float("inf")})


def test_results_without_lpips_are_scored_again_once_its_weights_are_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RADIOGS_BENCH_WEIGHTS", str(tmp_path))
    without = evaluation_code(EXPERIMENTS[TRAINING], FAKE)
    (tmp_path / "alexnet_features.npz").touch()
    (tmp_path / "alex.pth").touch()
    assert evaluation_code(EXPERIMENTS[TRAINING], FAKE) != without


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
def test_a_constant_changes_only_the_keys_that_depend_on_it(
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
    """Its folder holds everything that is installed."""
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
