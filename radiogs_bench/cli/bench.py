"""``radiogs-bench bench kernels|frames``: speed of the kernels and of a relit frame, beside yardsticks.

``bench steps`` and ``bench growth`` are in ``bench_steps``.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from . import bench_steps
from .options import add_verbose, names, positive

if TYPE_CHECKING:
    import torch

    from .options import Commands

KERNELS = ("trace", "rasterize", "shade", "harmonics", "split-sum")
SCENES = ("S", "M", "Mi")
SPACINGS = ("0.12", "0.06", "0.03")


def add_to(commands: "Commands") -> None:
    """Declare the command and its subject."""
    parser = commands.add_parser("bench", help="measure speed and memory", allow_abbrev=False)
    subjects = parser.add_subparsers(title="subjects", required=True, metavar="SUBJECT")
    measuring = subjects.add_parser("kernels", help="tracing, rasterizing, shading", allow_abbrev=False)
    measuring.set_defaults(command=bench_kernels)
    measuring.add_argument("--kernels", type=names, default=KERNELS, metavar="A,B", help="(default: all)")
    measuring.add_argument("--scenes", type=names, default=SCENES, metavar="A,B", help="(default: S,M,Mi)")
    measuring.add_argument("--points", type=Path, metavar="NPZ", help="real points, as gsplat's test_garden.npz")
    measuring.add_argument("--repetitions", type=positive, default=5, metavar="N", help="(default: 5)")
    framing = subjects.add_parser("frames", help="a relit frame, by rays and by surfels alone", allow_abbrev=False)
    framing.set_defaults(command=bench_frames)
    framing.add_argument("--scene", default="corner-128", help="a generated scene (default: corner-128)")
    framing.add_argument("--spacings", type=names, default=SPACINGS, metavar="A,B", help="world units between surfels")
    for each in (measuring, framing):
        each.add_argument("--device", choices=["cpu", "cuda"], default="cpu", help="(default: cpu)")
        each.add_argument("--json", type=Path, metavar="FILE", help="write everything that was measured")
        add_verbose(each)
    bench_steps.add_to(subjects)


def bench_kernels(options: argparse.Namespace) -> int:
    """Measure, print the table, and write the record."""
    import os

    from radiogs_core.errors import UsageError

    from ..lab.kernels import bench, record
    from ..lab.kernels.embree import missing_embree
    from ..store.atomic import write_atomically
    from ..store.provenance import session
    from ..store.seal import sealed, strict_json
    from .reporter import complain, say, show

    for kind, given, known in (("kernel", options.kernels, KERNELS), ("scene", options.scenes, SCENES)):
        for name in given:
            if name not in known:
                raise UsageError(f"there is no {kind} '{name}' to measure", "", f"There are: {', '.join(known)}.")
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
        write_atomically(options.json, strict_json(sealed(kept)))
    return 0


def bench_frames(options: argparse.Namespace) -> int:
    """Measure, print the table, and write the record."""
    from dataclasses import asdict

    from rich.table import Table

    from radiogs_datasets import load_scene

    from ..lab.kernels import frames
    from ..store.atomic import write_atomically
    from ..store.provenance import session
    from ..store.seal import sealed, strict_json
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
        write_atomically(options.json, strict_json(sealed(record)))
    return 0


def _device(name: str) -> "torch.device":
    import torch

    from radiogs_core.errors import UsageError

    if name == "cuda" and not torch.cuda.is_available():
        raise UsageError("there is no CUDA device", "PyTorch finds none.", "Use --device cpu.")
    return torch.device(name)


def _spacing(text: str) -> float:
    import math

    from radiogs_core.errors import UsageError

    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise UsageError(f"'{text}' is no distance between surfels", "It is a length above zero, in world units.")
    return value
