"""``radiogs-bench bench``: speed of the kernels, of relit frames and of single steps, and how steps grow with size."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radiogs_core.errors import UsageError, unknown

from .device import chosen_device
from .options import METHOD, add_verbose, declare, names, positive

if TYPE_CHECKING:
    from ..lab.steps.sizes import Size
    from ..lab.steps.subject import Subject
    from .options import Commands

KERNELS = ("trace", "rasterize", "shade", "harmonics", "split-sum")
SCENES = ("S", "M", "Mi")
SPACINGS = ("0.12", "0.06", "0.03")

STEP_SIZES = ("tiny", "20k")
"""Sizes of ``bench steps`` that take a minute or two."""


def add_to(commands: "Commands") -> None:
    """Declare the command and its subjects."""
    parser = declare(
        commands, "bench", "Measure the speed and memory of kernels, frames and single steps.",
        "bench kernels --kernels trace --scenes S",
    )  # fmt: skip
    subjects = parser.add_subparsers(title="subjects", required=True, metavar="SUBJECT")
    measuring = declare(
        subjects, "kernels", "Measure tracing, rasterizing and shading.", "bench kernels --kernels trace --scenes S"
    )
    measuring.set_defaults(command=bench_kernels)
    measuring.add_argument(
        "--kernels", type=names, default=KERNELS, metavar="A,B", help="Measure these kernels (default: all)."
    )
    measuring.add_argument(
        "--scenes", type=names, default=SCENES, metavar="A,B", help="Measure on these arrangements (default: S,M,Mi)."
    )
    measuring.add_argument(
        "--points", type=Path, metavar="NPZ", help="Also measure on real points, such as gsplat's test_garden.npz."
    )
    measuring.add_argument(
        "--repetitions", type=positive, default=5, metavar="N", help="Measure everything N times (default: 5)."
    )
    framing = declare(
        subjects, "frames", "Measure a relit frame, by rays and by surfels alone.", "bench frames --spacings 0.12"
    )
    framing.set_defaults(command=bench_frames)
    framing.add_argument("--scene", default="corner-128", help="Relight this generated scene (default: corner-128).")
    framing.add_argument(
        "--spacings", type=names, default=SPACINGS, metavar="A,B",
        help=f"Lay surfels at these distances, in world units (default: {','.join(SPACINGS)}).",
    )  # fmt: skip
    for each in (measuring, framing):
        _add_device_and_record(each)
    _add_steps(subjects)


def _add_device_and_record(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(threads=1)
    parser.add_argument(
        "--device", choices=["cpu", "cuda"], default="cpu", help="Measure on this device (default: cpu)."
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="Write everything that was measured to FILE.")
    add_verbose(parser)


def _add_steps(subjects: "Commands") -> None:
    """Declare the subjects ``steps`` and ``growth``."""
    steps = declare(
        subjects, "steps", "Measure a method's steps, starting points and relit frames.", "bench steps --sizes tiny"
    )
    steps.set_defaults(command=bench_steps)
    steps.add_argument(
        "--sizes", type=names, default=STEP_SIZES, metavar="A,B",
        help="Measure these sizes in this order: floor, tiny, long, 20k, small, paper, smoke (default: tiny,20k).",
    )  # fmt: skip
    steps.add_argument(
        "--passes", type=positive, metavar="N", help="Measure everything N times (default: 1 to 4, by size)."
    )
    steps.add_argument(
        "--stages", type=positive, metavar="N", help="Measure only the first N stages, and no relighting."
    )
    steps.add_argument(
        "--compare", type=Path, metavar="FILE", help="Print ratios to FILE, an earlier record from this machine."
    )
    growth = declare(
        subjects, "growth", "Measure how seconds and bytes grow with surfels, pixels and views.", "bench growth"
    )
    growth.set_defaults(command=bench_growth)
    growth.add_argument("--passes", type=positive, metavar="N", help="Measure every step N times (default: 3).")
    for each in (steps, growth):
        each.add_argument("--method", default=METHOD, metavar="NAME", help=f"Measure this method (default: {METHOD}).")
        each.add_argument("--scene", default="corner", help="Enlarge this scene to each size (default: corner).")
        _add_device_and_record(each)


def bench_kernels(options: argparse.Namespace) -> int:
    """Measure, print the table, and write the record."""
    import os
    from dataclasses import asdict

    from ..lab.kernels import bench
    from ..lab.kernels.embree import missing_embree
    from ..store.provenance import session
    from .reporter import complain, say, show

    for kind, given, known in (("kernel", options.kernels, KERNELS), ("scene", options.scenes, SCENES)):
        for name in given:
            if name not in known:
                raise unknown(kind, name, known)
    device = chosen_device(options)
    skipped = [missing_embree()] if "trace" in options.kernels and missing_embree() else []
    if options.points is None and "trace" in options.kernels:
        skipped.append("real geometry: no file was named with --points")
    rows = list(
        bench.bench_kernels(device, options.points, options.kernels, options.scenes, options.repetitions, complain)
    )
    team = os.cpu_count() or 1
    several = None
    if device.type == "cpu" and "trace" in options.kernels and "M" in options.scenes and team > 1:
        complain(f"trace, M, float32, {team} threads against one")
        several = bench.scaling(team, options.repetitions)
    show(bench.as_table(rows, device.type == "cuda"))
    for name in sorted({row.yardstick for row in rows if row.yardstick}):
        say(f"yardstick of {', '.join(sorted({row.kernel for row in rows if row.yardstick == name}))}: {name}")
    if several is not None:
        say(f"{team} threads: {several['forward']:.2f} x forward, {several['backward']:.2f} x backward (wall time)")
    for reason in skipped:
        say(f"skipped: {reason}")
    passes = [{**asdict(row), "millions_per_second": row.millions_per_second} for row in rows]
    _write(
        options.json,
        {"schema": bench.SCHEMA, **session(device), "rows": passes, "scaling": several, "skipped": skipped},
    )
    return 0


def bench_frames(options: argparse.Namespace) -> int:
    """Measure, print the table, and write the record."""
    from dataclasses import asdict

    from rich.table import Table

    from radiogs_datasets import load_scene

    from ..lab.kernels import frames
    from ..store.provenance import session
    from .reporter import complain, show

    device, spacings = chosen_device(options), [_spacing(text) for text in options.spacings]
    rows = list(frames.bench_frames(load_scene(options.scene), spacings, device, complain))
    table = Table("surfels", "apart", "by rays, ms", "by surfels alone, ms", "ratio")
    for row in rows:
        table.add_row(
            f"{row.surfels}", f"{row.spacing:g}",
            f"{row.rays_milliseconds:.1f}", f"{row.surfels_milliseconds:.1f}", f"{row.ratio:.1f}",
        )  # fmt: skip
    show(table)
    told = [{**asdict(row), "ratio": row.ratio} for row in rows]
    _write(options.json, {**session(device), "scene": options.scene, "rows": told})
    return 0


def _spacing(text: str) -> float:
    import math

    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise UsageError(
            f"'{text}' is no distance between surfels", "A distance is a length above zero, in world units."
        )
    return value


def bench_steps(options: argparse.Namespace) -> int:
    """Measure single steps, print them, with ratios to an earlier record if one was named, and write the record."""
    from radiogs_datasets import load_scene

    from ..lab.steps import record as recorded
    from ..lab.steps.measure import measured
    from ..lab.steps.passes import warm_up
    from ..lab.steps.sizes import WARM_UP, size_of
    from ..lab.steps.subject import require_size, subject_of
    from ..methods import method
    from ..store.provenance import session
    from .reporter import complain, say, show

    used, sizes = method(options.method), [size_of(name) for name in options.sizes]
    for size in sizes:
        require_size(used, size)
    device = chosen_device(options)
    record: dict[str, Any] = {"schema": recorded.SCHEMA, **session(device), **_place(options), "sizes": {}}
    earlier = {}
    if options.compare is not None:
        earlier = recorded.comparable_sizes(record, recorded.read_record(options.compare), options.sizes)

    def subject_at(size: "Size") -> "Subject":
        return subject_of(used, load_scene(options.scene), size, device)

    warm_up(subject_at(WARM_UP))
    for size in sizes:
        found = measured(subject_at, size, options.passes or size.passes, options.stages, complain)
        record["sizes"][size.name] = found
        show(recorded.as_table(size.name, found))
        for sentence in recorded.frames_said(found):
            say(sentence)
    _write(options.json, record)
    for name, before in earlier.items():
        show(recorded.ratio_table(name, record["sizes"][name], before))
    return 0


def bench_growth(options: argparse.Namespace) -> int:
    """Measure along every axis, print how seconds and bytes grow, and write the record."""
    from radiogs_datasets import load_scene

    from ..lab.steps.growth import PASSES, SCHEMA, bench_growth, growth_table
    from ..methods import method
    from ..store.provenance import session
    from .reporter import complain, show

    device = chosen_device(options)
    began = session(device)
    passes = PASSES if options.passes is None else options.passes
    rows = list(bench_growth(method(options.method), load_scene(options.scene), device, passes, complain))
    show(growth_table(rows))
    _write(options.json, {"schema": SCHEMA, **began, **_place(options), "rows": rows})
    return 0


def _place(options: argparse.Namespace) -> dict[str, str]:
    return {"method": options.method, "scene": options.scene}


def _write(path: Path | None, record: Mapping[str, Any]) -> None:
    from ..store.seal import write_sealed

    if path is not None:
        write_sealed(path, record)
