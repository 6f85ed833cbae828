"""``radiogs-bench run``: run a suite's cells, or continue them, then write and print its table."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter

from radiogs_core.errors import UsageError
from radiogs_datasets.options import AS_STORED, SceneOptions

from ..runs.engines.choice import Name
from ..runs.progress import working
from .options import (
    UNCHANGED,
    Changes,
    Computing,
    Count,
    Data,
    Json,
    MethodNames,
    Names,
    Opened,
    PresetName,
    ProtocolName,
    SceneNames,
    SuiteName,
    Trust,
)
from .reporter import complain, say
from .values import differences, from_text, part_of, views_kept

if TYPE_CHECKING:
    from ..runs.engines.choice import Engine
    from ..runs.plan import RunPlan
    from ..runs.spec import RunSpec
    from ..store.folder import Store
    from ..suites.suite import Suite


WHERE = Group("Where cells run", sort_key=1)


@dataclass(frozen=True)
class Asked:
    """Options of a run."""

    listed: Annotated[bool, Parameter(name="--list")] = False
    """List the suites, or describe the named one; run nothing."""
    scenes: SceneNames = ()
    """Run on these scenes, by name or folder (default: the suite's)."""
    seeds: Count = 1
    """Run seeds 0 to N-1."""
    as_published: bool = False
    """Run the published table that the suite reproduces: its scenes from --data, preset paper, its protocol and recipe
    printed, unless options change these."""
    preset: PresetName = ""
    """Take the amount of work of this preset (default: tiny; as published, paper)."""
    protocol: ProtocolName = ""
    """Score under this metric protocol (default: the suite's)."""
    out: Path | None = None
    """Keep the results in this folder (default: out/SUITE)."""
    method: MethodNames = ()
    """Run these methods (see `methods`, or TOML files) in the suite's table (default: the rows')."""
    trust: Trust = ()
    rows: Names = ()
    """Run these rows of the suite (default: all)."""
    keep_views: Annotated[int | None, from_text(views_kept), Parameter(metavar="N|all")] = None
    """Keep pictures of N test views with each result (default: as many as fit 128 MiB, uncompressed)."""
    dry_run: bool = False
    """List the cells with their expected time and memory; run nothing."""
    difference: Annotated[
        dict[str, float], from_text(differences), Parameter(accepts_keys=False, metavar="COLUMN=SIZE,...")
    ] = field(default_factory=dict)
    """With --dry-run, print how many scenes or seeds resolve this difference, such as albedo/psnr=0.3."""
    as_json: Json = False
    """Print events instead of tables, one JSON object a line."""


@dataclass(frozen=True)
class Where(Computing):
    """Options of where cells run; on a cluster a cell has one thread unless ``threads`` is given."""

    engine: Name | None = None
    """Run the cells in this process, in a pool of processes, or on a Ray cluster (default: inprocess). On a cluster a
    cell has 1 thread unless --threads is given."""
    workers: Count | None = None
    """Run N cells at a time in a pool that shares the threads."""
    ray_address: str | None = None
    """Use the Ray cluster at this HOST:PORT (default: start one on this machine)."""
    shard: Annotated[tuple[int, int], from_text(part_of), Parameter(metavar="I/N")] = (0, 1)
    """Run part I of N, counted from 0 (default: all). The parts' stores merge by copying their files together."""


def run(
    suite: SuiteName | None = None,
    /,
    *,
    asked: Annotated[Asked, Parameter(name="*")] = Asked(),
    changes: Changes = UNCHANGED,
    where: Annotated[Where, Parameter(name="*", group=WHERE)] = Where(),
    data: Data = None,
    opened: Opened = AS_STORED,
    words: Annotated[tuple[str, ...], Parameter(parse=False)] = (),
) -> int:
    """Run the cells of a suite, or continue them, and write and print its table.

    Example:  radiogs-bench run ablations --preset smoke --scenes corner --seeds 2

    :param suite: Name a suite (see --list), or a TOML file.
    """
    from .events import emit, errors_told

    with errors_told(asked.as_json):
        if asked.listed:
            _list(suite, asked.as_json)
            code = 0
        elif suite is None:
            raise UsageError("no suite was named", "", "See them all:  radiogs-bench run --list")
        else:
            with working(f"planning {suite}"):  # shown before PyTorch is imported
                spec = _spec(suite, asked, changes, where, opened)
            code = _run(spec, asked, where, words)
    if asked.as_json:
        emit("end", exit_code=code)
    return code


def _spec(suite: str, asked: Asked, changes: Changes, where: Where, opened: SceneOptions) -> "RunSpec":
    """The run that the options ask for. Raises UsageError for invalid values."""
    from ..runs.spec import RunSpec

    return RunSpec(
        suite,
        methods=asked.method,
        rows=asked.rows,
        scenes=asked.scenes,
        scene_options=opened,
        seeds=asked.seeds,
        preset=asked.preset,
        settings=changes.fields(),
        recipe=changes.recipe,
        effects=changes.effects,
        protocol=asked.protocol,
        as_published=asked.as_published,
        device=where.device,
        threads=where.threads,
        shard=where.shard,
        keep_views=asked.keep_views,
    )


def _run(spec: "RunSpec", asked: Asked, where: Where, words: Sequence[str]) -> int:
    """Run or continue a suite, or show what would run; returns the exit code."""
    from ..runs.engines.choice import choose
    from ..runs.plan import resolve, suite_asked
    from ..store.folder import Store
    from ..suites.scenes import absent_scenes

    engine, (suite, preset, _) = choose(where.engine, where.workers, where.ray_address, spec.threads), suite_asked(spec)
    store = Store(asked.out or Path("out") / suite.name)
    if asked.dry_run:
        if not asked.as_json:
            say(planned_size(suite, spec, preset, store.folder))
        if not spec.scenes and (absent := absent_scenes(suite)):
            say_lines(plan_without_data(suite, absent), asked.as_json)
            return 0
    from ..device import usable_cores, use  # brings the kernels

    use(spec.device, spec.threads, planned=asked.dry_run)
    with working(f"reading the scenes of {spec.suite}"):
        plan = resolve(spec)
    say_lines(plan.remarks, asked.as_json)
    if not asked.dry_run:
        return _carried_out(plan, store, engine, asked.as_json, words)
    from .plan import emit_plan, show_plan

    if asked.as_json:
        emit_plan(plan, store, asked.difference)
    else:
        show_plan(plan, store, *engine.cells_and_threads(usable_cores()), asked.difference)
    return 0


def planned_size(suite: "Suite", spec: "RunSpec", preset: str, out: Path) -> str:
    """The cells of a run and the folder of its results in a sentence, known before scenes are read."""
    counts = {"scene": len(spec.scenes or suite.scenes), "row": len(suite.rows), "seed": spec.seeds}
    cells, state = math.prod(counts.values()), "continued" if (out / "sweep.json").exists() else "new"
    size = " x ".join(f"{count} {noun}{'s' * (count != 1)}" for noun, count in counts.items())
    return f"{suite.name}: {size}: {cells} cells of preset {preset}, into {out} ({state}). A dry run trains nothing."


def plan_without_data(suite: "Suite", absent: Sequence[str]) -> list[str]:
    """Sentences on a run whose scenes have to be downloaded first."""
    return [
        f"not here: {', '.join(absent)}. {suite.download}",
        f"Fetch them:  radiogs-bench datasets fetch {suite.data_set} --data ROOT",
        "Time and memory are known once a scene is here: `rehearse` measures them in minutes, on any of its scenes.",
    ]


def _carried_out(plan: "RunPlan", store: "Store", engine: "Engine", as_json: bool, words: Sequence[str]) -> int:
    """Run the missing cells, and write and print the reports; returns the exit code. Raises as ``verdicts`` does."""
    from ..results.reports import verdicts
    from ..whole_runs import Audience, carry_out, other_run
    from .events import EventProgress, emit

    to = Audience(lambda line: say_lines([line], as_json), complain, table=not as_json)
    if as_json:
        to = replace(to, progress=lambda store, cells: EventProgress(store, [ref for ref, _ in cells]))
    code, manifest = carry_out(plan, store, engine, to, words)
    from .showing import write, write_and_show  # not before there are results: errors need not wait for its tables

    if as_json:
        for path in write(store, manifest)[1]:
            emit("written", path=str(path))
    else:
        write_and_show(store, manifest)
        if remark := other_run(store, manifest):
            say(remark)
    say_lines(verdicts(plan, store), as_json)
    return code


def _list(name: str | None, as_json: bool) -> None:
    """Print the suites, or describe the named one."""
    from ..suites.registry import SUITES, suite

    suites = [suite(name)] if name else list(SUITES.values())
    if as_json:
        from .events import emit_suite

        for each in suites:
            emit_suite(each)
    elif name:
        say(*describe(suites[0]))
    else:
        width = max(len(each.name) for each in suites)
        for each in suites:
            say(f"{each.name:{width}}  {each.title}")
        say("Rows, columns and scenes of one:  radiogs-bench run SUITE --list")


def describe(suite: "Suite") -> list[str]:
    """Describe a suite in a few lines: title, rows, columns, scenes, where to find them, protocol, recipe."""
    return [
        f"{suite.name}: {suite.title} ({len(suite.rows)} rows, {len(suite.columns)} metrics)",
        f"  rows: {', '.join(row.key for row in suite.rows)}",
        f"  columns: {', '.join(metric.key for metric in suite.columns)}",
        f"  scenes: {', '.join(suite.scenes)}",
        *([f"  download: {suite.download}"] if suite.download else []),
        *([f"  protocol: {suite.protocol}"] if suite.protocol != "default" else []),
        *([f"  recipe: {suite.recipe}, in rows that name no other"] if suite.recipe else []),
    ]


def say_lines(lines: Sequence[str], as_json: bool) -> None:
    """Print lines, or write them as events."""
    from .events import emit

    for line in lines:
        emit("message", text=line) if as_json else say(line)
