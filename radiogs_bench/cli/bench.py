"""``radiogs-bench bench``: speed of the kernels, of relit frames and of single steps, and how steps grow with size."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, Parameter

from radiogs_core.errors import unknown

from .options import METHOD, OPTIONS, Count, MethodName, Names, SceneName
from .reporter import complain, say, show
from .values import factor, from_text, names

if TYPE_CHECKING:
    from ..lab.steps.sizes import Size
    from ..lab.steps.subject import Subject

KERNELS = ("trace", "rasterize", "shade", "harmonics", "split-sum")
SCENES = ("S", "M", "Mi")

Device = Annotated[Literal["cpu", "cuda"], Parameter(help="Measure on this device.")]
RecordFile = Annotated[Path | None, Parameter(name="--json", help="Write everything that was measured to this file.")]
Method = Annotated[MethodName, Parameter(help="Measure this method.")]


@Parameter(name="*")
@dataclass(frozen=True)
class Place:
    """Where steps are measured, and where the measurements are written."""

    scene: SceneName = "corner"
    """Enlarge this scene to each size."""
    device: Device = "cpu"
    record: RecordFile = None


AT_CORNER = Place()

bench = App(
    name="bench",
    group_parameters=OPTIONS,
    help="""Measure the speed and memory of kernels, frames and single steps.

    Example:  radiogs-bench bench kernels --kernels trace --scenes S
    """,
)


@bench.command(name="kernels")
def bench_kernels(
    *,
    kernels: Names = KERNELS,
    scenes: Names = SCENES,
    points: Path | None = None,
    repetitions: Count = 5,
    device: Device = "cpu",
    record: RecordFile = None,
) -> None:
    """Measure tracing, rasterizing and shading.

    Example:  radiogs-bench bench kernels --kernels trace --scenes S

    :param kernels: Measure these kernels.
    :param scenes: Measure on these arrangements.
    :param points: Also measure on real points in an .npz file, such as gsplat's test_garden.npz.
    :param repetitions: Measure everything N times.
    """
    import os
    from dataclasses import asdict

    from ..device import use
    from ..lab.kernels import bench
    from ..lab.kernels.embree import missing_embree
    from ..store.provenance import session

    for kind, given, known in (("kernel", kernels, KERNELS), ("scene", scenes, SCENES)):
        for name in given:
            if name not in known:
                raise unknown(kind, name, known)
    used = use(device, 1)
    skipped = [missing_embree()] if "trace" in kernels and missing_embree() else []
    if points is None and "trace" in kernels:
        skipped.append("real geometry: no file was named with --points")
    rows = list(bench.bench_kernels(used, points, kernels, scenes, repetitions, complain))
    team = os.cpu_count() or 1
    several = None
    if device == "cpu" and "trace" in kernels and "M" in scenes and team > 1:
        complain(f"trace, M, float32, {team} threads against one")
        several = bench.scaling(team, repetitions)
    show(bench.as_table(rows, device == "cuda"))
    for name in sorted({row.yardstick for row in rows if row.yardstick}):
        say(f"yardstick of {', '.join(sorted({row.kernel for row in rows if row.yardstick == name}))}: {name}")
    if several is not None:
        say(f"{team} threads: {several['forward']:.2f} x forward, {several['backward']:.2f} x backward (wall time)")
    for reason in skipped:
        say(f"skipped: {reason}")
    passes = [{**asdict(row), "millions_per_second": row.millions_per_second} for row in rows]
    _write(record, {"schema": bench.SCHEMA, **session(used), "rows": passes, "scaling": several, "skipped": skipped})


@bench.command(name="frames")
def bench_frames(
    *,
    scene: SceneName = "corner-128",
    spacings: Annotated[
        tuple[float, ...], from_text(lambda text: tuple(map(factor, names(text)))), Parameter(metavar="A,B")
    ] = (0.12, 0.06, 0.03),
    device: Device = "cpu",
    record: RecordFile = None,
) -> None:
    """Measure a relit frame, by rays and by surfels alone.

    Example:  radiogs-bench bench frames --spacings 0.12

    :param scene: Relight this generated scene.
    :param spacings: Lay surfels at these distances, in world units.
    """
    from dataclasses import asdict

    from rich.table import Table

    from radiogs_datasets import load_scene

    from ..device import use
    from ..lab.kernels import frames
    from ..store.provenance import session

    used = use(device, 1)
    rows = list(frames.bench_frames(load_scene(scene), spacings, used, complain))
    table = Table("surfels", "apart", "by rays, ms", "by surfels alone, ms", "ratio")
    for row in rows:
        table.add_row(
            f"{row.surfels}", f"{row.spacing:g}",
            f"{row.rays_milliseconds:.1f}", f"{row.surfels_milliseconds:.1f}", f"{row.ratio:.1f}",
        )  # fmt: skip
    show(table)
    _write(record, {**session(used), "scene": scene, "rows": [{**asdict(row), "ratio": row.ratio} for row in rows]})


@bench.command(name="steps")
def bench_steps(
    *,
    sizes: Names = ("tiny", "20k"),
    passes: Count | None = None,
    stages: Count | None = None,
    compare: Path | None = None,
    method: Method = METHOD,
    at: Place = AT_CORNER,
) -> None:
    """Measure a method's steps, starting points and relit frames.

    Example:  radiogs-bench bench steps --sizes tiny

    :param sizes: Measure these sizes in this order: floor, tiny, long, 20k, small, paper, smoke.
    :param passes: Measure everything N times (default: 1 to 4, by size).
    :param stages: Measure only the first N stages, and no relighting.
    :param compare: Print ratios to an earlier record from this machine in this file.
    """
    from radiogs_datasets import load_scene

    from ..device import use
    from ..lab.steps import record as recorded
    from ..lab.steps.measure import measured
    from ..lab.steps.passes import warm_up
    from ..lab.steps.sizes import WARM_UP, size_of
    from ..lab.steps.subject import require_size, subject_of
    from ..methods import method as installed
    from ..store.provenance import session

    used, chosen = installed(method), [size_of(name) for name in sizes]
    for size in chosen:
        require_size(used, size)
    device = use(at.device, 1)
    record: dict[str, Any] = {
        "schema": recorded.SCHEMA, **session(device), "method": method, "scene": at.scene, "sizes": {},
    }  # fmt: skip
    earlier = {} if compare is None else recorded.comparable_sizes(record, recorded.read_record(compare), sizes)

    def subject_at(size: "Size") -> "Subject":
        return subject_of(used, load_scene(at.scene), size, device)

    warm_up(subject_at(WARM_UP))
    for size in chosen:
        found = measured(subject_at, size, passes or size.passes, stages, complain)
        record["sizes"][size.name] = found
        show(recorded.as_table(size.name, found))
        say(*recorded.frames_said(found))
    _write(at.record, record)
    for name, before in earlier.items():
        show(recorded.ratio_table(name, record["sizes"][name], before))


@bench.command(name="growth")
def bench_growth(*, passes: Count | None = None, method: Method = METHOD, at: Place = AT_CORNER) -> None:
    """Measure how seconds and bytes grow with surfels, pixels and views.

    Example:  radiogs-bench bench growth

    :param passes: Measure every step N times (default: 3).
    """
    from radiogs_datasets import load_scene

    from ..device import use
    from ..lab.steps.growth import PASSES, SCHEMA, bench_growth, growth_table
    from ..methods import method as installed
    from ..store.provenance import session

    device = use(at.device, 1)
    began = session(device)
    rows = list(bench_growth(installed(method), load_scene(at.scene), device, passes or PASSES, complain))
    show(growth_table(rows))
    _write(at.record, {"schema": SCHEMA, **began, "method": method, "scene": at.scene, "rows": rows})


def _write(path: Path | None, record: Mapping[str, Any]) -> None:
    from ..store.seal import write_sealed

    if path is not None:
        write_sealed(path, record)
