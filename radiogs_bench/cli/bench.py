"""``radiogs-bench bench``: speed of the kernels, of relit frames and of single steps, and how steps grow with size."""

import argparse
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radiogs_core.errors import UsageError, unknown

from .device import chosen_device
from .options import METHOD, add_verbose, declare, names, positive

if TYPE_CHECKING:
    import torch

    from ..lab.steps.sizes import Size
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
    steps.set_defaults(command=bench_steps, threads=1)
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
    other = steps.add_mutually_exclusive_group()
    other.add_argument(
        "--compare", type=Path, metavar="FILE", help="Print ratios to FILE, an earlier record from this machine."
    )
    other.add_argument(
        "--against", type=Path, metavar="CHECKOUT", help="Print ratios to another checkout; passes of both alternate."
    )
    steps.add_argument(
        "--history", type=Path, metavar="FILE", help="Add a line to FILE: this commit's times relative to yardsticks."
    )
    growth = declare(
        subjects, "growth", "Measure how seconds and bytes grow with surfels, pixels and views.", "bench growth"
    )
    growth.set_defaults(command=bench_growth, threads=1)
    growth.add_argument("--passes", type=positive, metavar="N", help="Measure every step N times (default: 3).")
    for each in (steps, growth):
        each.add_argument("--method", default=METHOD, metavar="NAME", help=f"Measure this method (default: {METHOD}).")
        each.add_argument("--scene", default="corner", help="Enlarge this scene to each size (default: corner).")
        _add_device_and_record(each)


def bench_kernels(options: argparse.Namespace) -> int:
    """Measure, print the table, and write the record."""
    import os

    from ..lab.kernels import bench, record
    from ..lab.kernels.embree import missing_embree
    from ..store.provenance import session
    from ..store.seal import write_sealed
    from .reporter import complain, say, show

    for kind, given, known in (("kernel", options.kernels, KERNELS), ("scene", options.scenes, SCENES)):
        for name in given:
            if name not in known:
                raise unknown(kind, name, known)
    device = _device(options.device)
    reasons = [missing_embree()] if "trace" in options.kernels else []
    if options.points is None and "trace" in options.kernels:
        reasons.append("real geometry: no file was named with --points")
    skipped = [reason for reason in reasons if reason]
    rows = list(
        bench.bench_kernels(
            device, options.points, tuple(options.kernels), tuple(options.scenes), options.repetitions, complain
        )
    )
    team = os.cpu_count() or 1
    scaling = None
    if device.type == "cpu" and "trace" in options.kernels and "M" in options.scenes and team > 1:
        complain(f"trace, M, float32, {team} threads against one")
        scaling = bench.scaling(team, options.repetitions)
    show(record.as_table(rows, device.type == "cuda"))
    for name in sorted({row.yardstick for row in rows if row.yardstick}):
        say(f"yardstick of {', '.join(sorted({row.kernel for row in rows if row.yardstick == name}))}: {name}")
    if scaling is not None:
        say(f"{team} threads: {scaling['forward']:.2f} x forward, {scaling['backward']:.2f} x backward (wall time)")
    for reason in skipped:
        say(f"skipped: {reason}")
    if options.json is not None:
        kept = record.as_json(rows, scaling, skipped, dict(session(device)))
        write_sealed(options.json, kept)
    return 0


def bench_frames(options: argparse.Namespace) -> int:
    """Measure, print the table, and write the record."""
    from dataclasses import asdict

    from rich.table import Table

    from radiogs_datasets import load_scene

    from ..lab.kernels import frames
    from ..store.provenance import session
    from ..store.seal import write_sealed
    from .reporter import complain, show

    device, spacings = _device(options.device), [_spacing(text) for text in options.spacings]
    rows = list(frames.bench_frames(load_scene(options.scene), spacings, device, complain))
    table = Table("surfels", "apart", "by rays, ms", "by surfels alone, ms", "ratio")
    for row in rows:
        table.add_row(
            f"{row.surfels}", f"{row.spacing:g}",
            f"{row.rays_milliseconds:.1f}", f"{row.surfels_milliseconds:.1f}", f"{row.ratio:.1f}",
        )  # fmt: skip
    show(table)
    if options.json is not None:
        record = {**session(device), "scene": options.scene, "rows": [{**asdict(r), "ratio": r.ratio} for r in rows]}
        write_sealed(options.json, record)
    return 0


def _device(name: str) -> "torch.device":
    import torch

    if name == "cuda" and not torch.cuda.is_available():
        raise UsageError(
            "no CUDA device was found", "PyTorch sees no GPU, or is a build without CUDA.", "Leave --device cuda out."
        )
    return torch.device(name)


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
    """Measure single steps, print, and write the record."""
    from ..lab.steps.sizes import size_of
    from ..lab.steps.subject import require_size
    from ..methods import method

    used, sizes = method(options.method), [size_of(name) for name in options.sizes]
    for size in sizes:
        require_size(used, size)
    return _alone(options, sizes) if options.against is None else _in_turn(options, sizes)


def bench_growth(options: argparse.Namespace) -> int:
    """Measure along every axis, print how seconds and bytes grow, and write the record."""
    from radiogs_datasets import load_scene

    from ..lab.steps.growth import PASSES, SCHEMA, bench_growth
    from ..lab.steps.growth_table import growth_table
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


def _alone(options: argparse.Namespace, sizes: Sequence["Size"]) -> int:
    """Measure this checkout in this process, beside yardsticks; print ratios to an earlier record if one was named."""
    from ..lab.steps.history import append, line_of
    from ..lab.steps.measure import Here, measured
    from ..lab.steps.ratios import read_record, require_comparable
    from ..lab.steps.record import as_table, frames_said, record_of, yardstick_said
    from ..lab.steps.worker import named_subject
    from ..lab.steps.yardsticks import Yardsticks
    from ..store.provenance import session
    from .reporter import complain, say, show

    device, found = chosen_device(options), {}
    began = session(device)
    earlier = None if options.compare is None else read_record(options.compare)
    if earlier is not None:
        require_comparable({**began, **_place(options)}, earlier)
    yardsticks = Yardsticks()
    here = Here(partial(named_subject, options.method, options.scene, options.device), options.stages)
    for size in sizes:
        yardsticks.measure()
        (found[size.name],) = measured([here], size, options.passes or size.passes, complain)
        show(as_table(size.name, found[size.name]))
        for sentence in frames_said(found[size.name]):
            say(sentence)
    yardsticks.measure()
    record = record_of(began, _place(options), yardsticks, found)
    say(yardstick_said(record))
    if earlier is not None:
        _ratios(found, earlier["sizes"], paired=False)
    _write(options.json, record)
    if options.history is not None:
        append(options.history, line_of(record))
    return 0


def _in_turn(options: argparse.Namespace, sizes: Sequence["Size"]) -> int:
    """Measure this checkout and another one, each in its own process, pass by pass in turn."""
    from ..lab.steps.against import worker
    from ..lab.steps.measure import measured
    from ..lab.steps.ratios import AGAINST
    from ..store.provenance import session
    from .reporter import complain

    if options.history is not None:
        raise UsageError(
            "--history does not go with --against", "It keeps the times of this checkout alone.", "Leave --against out."
        )
    device, ours, theirs = chosen_device(options), {}, {}
    given = (options.method, options.scene, options.device, str(options.stages or 0))
    with worker(options.against, given, options.sizes) as other, worker(None, given, options.sizes) as this:
        for size in sizes:
            passes = options.passes or size.passes
            theirs[size.name], ours[size.name] = measured([other, this], size, passes, complain)
        commits = {"this": this.origin["git"], "other": other.origin["git"]}
    ratios = _ratios(ours, theirs, paired=True)
    record = {"this": ours, "other": theirs, "commits": commits, "ratios": ratios}
    _write(options.json, {"schema": AGAINST, **session(device), **_place(options), **record})
    return 0


def _ratios(ours: Mapping[str, Any], theirs: Mapping[str, Any], paired: bool) -> dict[str, list[dict[str, Any]]]:
    """Print the ratios of the sizes that both have, and return them."""
    from ..lab.steps.ratios import as_table, compared
    from .reporter import show

    found = {name: list(compared(each, theirs[name], paired)) for name, each in ours.items() if name in theirs}
    if not found:
        raise UsageError(
            "the record has none of these sizes", f"It has: {', '.join(theirs)}.", "Name them with --sizes."
        )
    for name, ratios in found.items():
        show(as_table(name, ratios))
    return found


def _place(options: argparse.Namespace) -> dict[str, str]:
    return {"method": options.method, "scene": options.scene}


def _write(path: Path | None, record: Mapping[str, Any]) -> None:
    from ..store.seal import write_sealed

    if path is not None:
        write_sealed(path, record)
