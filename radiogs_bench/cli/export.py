"""``radiogs-bench export``: a run's metrics as one table, its training curves, or a trained model in some form.

A trained model becomes a file of surfels as another program reads them (``--to``), a triangle mesh with its distance
from the true shape (``--mesh``), or its test views as a public code writes its own (``--layout-of``).
"""

import argparse
import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .device import chosen_device
from .options import add_data, add_device, add_verbose, declare
from .trusting import add_trust

if TYPE_CHECKING:
    from radiogs_core.scene.scene import Scene

    from ..export.fusion import Lattice
    from ..export.mesh import Mesh
    from .options import Commands

TABLES = ("csv", "json", "parquet")
LOGS = ("tensorboard", "wandb")
"""Training curves, for a logger."""

FORMS = ("3dgs-ply", "2dgs-ply", "supersplat")
"""Files of surfels: the forms of ``radiogs_core.surfels.viewer_files``, whose import takes too long for `--help`."""

SCHEMA = "radiogs-bench/mesh/1"
"""The schema of mesh.json."""


def add_to(commands: "Commands") -> None:
    """Declare the command."""
    parser = declare(
        commands, "export",
        "Write a run's metrics as one table or as a logger's files, or a trained model as surfels, a mesh or images.",
        "export out/ablations --to csv", help="Write a run's metrics, or a trained model, for other programs.",
    )  # fmt: skip
    parser.set_defaults(command=export)
    parser.add_argument("out", type=Path, metavar="OUT", help="Read the run or the model in this folder.")
    add_verbose(parser)
    parser.add_argument(
        "--to", choices=(*TABLES, *LOGS, *FORMS), default="csv",
        help="Write metrics (csv, json, parquet), training curves (tensorboard, wandb), or surfels (the others)"
        " (default: csv).",
    )  # fmt: skip
    parser.add_argument(
        "--file", type=Path,
        help="Write to this file or folder (default: OUT/export.csv and so on, OUT/tensorboard, OUT/wandb,"
        " OUT/3dgs.ply, OUT/mesh.ply, OUT/CODE).",
    )  # fmt: skip
    parser.add_argument("--row", metavar="ROW", help="Write the surfels of this row of a run (default: the first).")
    add_trust(parser)
    _add_mesh(parser)
    _add_layout(parser)


def _add_mesh(parser: argparse.ArgumentParser) -> None:
    """Add ``--mesh`` and its options."""
    group = parser.add_argument_group("a model of `train` as a mesh")
    group.add_argument(
        "--mesh", action="store_true", help="Fuse the depth maps of its views, and write the mesh to OUT/mesh.ply."
    )
    group.add_argument(
        "--voxel", type=above_zero, metavar="SHARE",
        help="Make voxels this share of the scene's extent (default: 1/512, or half a pixel if that is larger).",
    )  # fmt: skip
    group.add_argument(
        "--truncation", type=above_zero, default=4.0, metavar="VOXELS",
        help="Keep distances up to this many voxels from surfaces (default: 4).",
    )  # fmt: skip
    group.add_argument(
        "--memory", type=above_zero, default=2.0, metavar="GIB", help="Use at most this much for voxels (default: 2)."
    )
    group.add_argument(
        "--views", choices=["train", "test"], default="train", help="Fuse the views of this split (default: train)."
    )
    add_device(group)
    add_data(group)


def _add_layout(parser: argparse.ArgumentParser) -> None:
    """Add ``--layout-of`` and its options; device and data are those of ``_add_mesh``."""
    group = parser.add_argument_group("the test views of a model of `train` as files (docs/scoring.md)")
    group.add_argument(
        "--layout-of", metavar="CODE",
        help="Write new views, materials and relit views as this public code does: radiogs, irgs, gs-ir, gi-gs, r3dg,"
        " svg-ir or tensoir.",
    )  # fmt: skip
    group.add_argument(
        "--bits",
        type=int,
        choices=[8, 16],
        default=8,
        help="Write images of this many bits (default: 8, as the codes).",
    )
    group.add_argument(
        "--protocol", default="default",
        help="Relight with the albedo scale of this metric protocol (default: default).",
    )  # fmt: skip


def export(options: argparse.Namespace) -> int:
    """Write one table of every metric in the store, its training curves, or a trained model in some form."""
    if options.mesh:
        return export_mesh(options)
    if options.layout_of is not None:
        return export_layout(options)
    if options.to in FORMS:
        return export_splats(options)
    from radiogs_core.own_files import own_folder, require_own_folders

    from ..export.records import export as write
    from ..runs.sweep import read_sweep
    from ..store.folder import Store
    from .reporter import say, say_aside

    sweep = read_sweep(options.out)  # says what to do where there is no run
    store = Store(options.out)
    if options.to == "tensorboard":
        from ..export.loggers import write_event_files

        folder = options.file or own_folder(options.out / options.to, options.out)
        say(f"{folder}: progress of {write_event_files(store, sweep, folder)} cells")
        return 0
    if options.to == "wandb":
        from ..export.loggers import write_wandb_runs

        folder = options.file or options.out
        require_own_folders(folder, options.to)
        count = write_wandb_runs(store, sweep, folder)
        say(f"{folder / 'wandb'}: progress of {count} cells; send it:  wandb sync {folder / 'wandb'}/offline-run-*")
        return 0
    path = options.file or options.out / f"export.{options.to}"
    say(f"{path}: {write(store, path, options.to)} values")
    say_aside(store)
    return 0


def export_splats(options: argparse.Namespace) -> int:
    """Write the surfels into OUT/FORM.ply, or the file of --file, and print their number."""
    import torch

    from radiogs_core.errors import DataError
    from radiogs_core.surfels.viewer_files import write_for_viewer

    from ..export.trained_surfels import initial_viewpoint_in, surfels_in
    from ..store.atomic import explained
    from .reporter import say

    surfels = surfels_in(options.out, options.row)
    if not len(surfels):
        raise DataError(f"the model in '{options.out}' has no surfels left", "There is nothing to write.")
    seen_from = initial_viewpoint_in(options.out, options.row)
    up = torch.tensor([0.0, 0.0, 1.0]) if seen_from is None else seen_from.up
    path: Path = options.file or options.out / f"{options.to.removesuffix('-ply')}.ply"
    with explained(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_for_viewer(surfels, options.to, up, path)
    say(f"{path}: {len(surfels)} surfels, colours as on a display")
    return 0


def export_layout(options: argparse.Namespace) -> int:
    """Write the test views' files into OUT/CODE, or the folder of --file, and print the command that scores them."""
    from radiogs_baselines.outputs.writing import LayoutWriter
    from radiogs_core.own_files import require_own_folders

    from ..export.published_layout import checked, write_as_published
    from ..runs.progress import progress_for_stderr
    from ..runs.trained_folder import read_about, read_trained
    from ..scoring.metrics.protocols import protocol
    from ..store.folder import Store
    from .reporter import say

    folder: Path = options.file or options.out / options.layout_of
    if options.file is None:
        require_own_folders(options.out, options.layout_of)
    with Store(options.out).keeping_tracebacks(), progress_for_stderr() as progress:
        about = read_about(options.out)
        run, model = read_trained(options.out, chosen_device(options))
        written = write_as_published(
            model, run, LayoutWriter(folder, checked(options.layout_of), run.scene, options.bits), about["method"],
            protocol(options.protocol),
            lambda done, total: progress.advance(f"writing {folder}", done, total),
        )  # fmt: skip
    say(f"{written} files in {folder}")
    say(f"Score them:  radiogs-bench score {folder} --scene {about['scene']} --from {options.layout_of}")
    return 0


def above_zero(text: str) -> float:
    """A finite number above zero."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"'{text}' is not a number above zero")
    return value


def export_mesh(options: argparse.Namespace) -> int:
    """Write the mesh and, beside it, mesh.json: its settings, and its distances from the true shape if known."""
    from ..export.mesh import lattice_of, mesh_of, write_mesh
    from ..runs.progress import progress_for_stderr
    from ..runs.trained_folder import read_about, read_trained
    from ..store.folder import Store
    from ..store.seal import write_sealed
    from .model import prepared
    from .reporter import say

    device = chosen_device(options)
    with Store(options.out).keeping_tracebacks(), progress_for_stderr() as progress:
        run, model = read_trained(options.out, device)
        name, scene = read_about(options.out)["method"], run.scene
        lattice = lattice_of(scene, options.voxel, options.truncation)
        made = mesh_of(
            prepared(name, model), scene.train if options.views == "train" else scene.test, lattice,
            int(options.memory * 2**30), partial(progress.advance, "fusing depth maps"), device=device, method=name,
        )  # fmt: skip
        path: Path = options.file or options.out / "mesh.ply"
        write_mesh(made, path)
        say(f"{path}: {len(made.vertices)} vertices, {len(made.faces)} faces, voxels of {lattice.voxel:.4g}")
        record = record_of(made, scene, lattice, options.views)
    write_sealed(path.with_suffix(".json"), record)
    for line in sentences_of(record["shape"]):
        say(line)
    return 0


def record_of(mesh: "Mesh", scene: "Scene", lattice: "Lattice", views: str) -> dict[str, Any]:
    """Record of a mesh: settings in world units, and distances from the true shape as shares of the extent."""
    return {
        "schema": SCHEMA,
        "scene": scene.name,
        "checksum": scene.checksum,
        "extent": scene.extent,
        "views": views,
        "voxel": lattice.voxel,
        "truncation": lattice.truncation,
        "farthest": lattice.farthest,
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "shape": shape_of(mesh, scene),
    }


def shape_of(mesh: "Mesh", scene: "Scene") -> dict[str, Any]:
    """Accuracy, completeness and Chamfer distance, or the reason why there are none."""
    from radiogs_core.errors import DataError, UsageError

    from ..scoring.metrics.surface_distance import chamfer, surface_distance
    from ..scoring.true_shape import true_shape

    try:
        truth = true_shape(scene)
        found = surface_distance(mesh.vertices, mesh.faces, truth.points, truth.distance, scene.extent)
    except DataError as unknown:
        return {"reason": f"{unknown.what}: {unknown.why}"}
    except UsageError as lacking:
        return {"reason": f"{lacking.what}: {lacking.remedy}"}
    shape = {
        "truth": truth.source,
        "accuracy": found.accuracy,
        "completeness": found.completeness,
        "chamfer": found.chamfer,
        "samples": list(found.samples),
        "seed": found.seed,
    }
    if truth.vertices is not None:
        shape["stanford_orb_chamfer"] = chamfer(mesh.vertices, mesh.faces, truth.vertices)
    return shape


def sentences_of(shape: dict[str, Any]) -> list[str]:
    """A shape's record in sentences."""
    if "reason" in shape:
        return [f"Chamfer distance: n/a, {shape['reason']}"]
    ours, theirs = shape["samples"]
    lines = [
        f"Chamfer distance {100 * shape['chamfer']:.3f} % of the scene's extent: accuracy"
        f" {100 * shape['accuracy']:.3f} % ({ours} points on the mesh), completeness"
        f" {100 * shape['completeness']:.3f} % ({theirs} true points); seed {shape['seed']}",
        f"truth: {shape['truth']}",
    ]
    if "stanford_orb_chamfer" in shape:
        lines.append(f"by Stanford-ORB's definition, mean squares in world units: {shape['stanford_orb_chamfer']:.6f}")
    return lines


if TYPE_CHECKING:
    from pathlib import Path
