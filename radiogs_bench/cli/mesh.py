"""``radiogs-bench export --mesh``: a trained model as a triangle mesh, and how far that is from the true shape."""

import argparse
import math
from functools import partial
from typing import TYPE_CHECKING, Any

from .device import chosen_device
from .options import add_data, positive

if TYPE_CHECKING:
    from pathlib import Path

    from radiogs_core.scene.scene import Scene

    from ..export.fusion import Lattice
    from ..export.mesh import Mesh


SCHEMA = "radiogs-bench/mesh/1"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--mesh`` and what belongs to it."""
    group = parser.add_argument_group("of a model that `train` made")
    group.add_argument("--mesh", action="store_true", help="write the fused depth maps of its views as OUT/mesh.ply")
    group.add_argument(
        "--voxel", type=above_zero, metavar="SHARE",
        help="size of a voxel as a share of the scene's extent (default: 1/512, or half a pixel if that is larger)",
    )  # fmt: skip
    group.add_argument(
        "--truncation", type=above_zero, default=4.0, metavar="VOXELS",
        help="how far from surfaces distances are kept (default: 4)",
    )  # fmt: skip
    group.add_argument(
        "--memory", type=above_zero, default=2.0, metavar="GIB", help="that voxels may take (default: 2)"
    )
    group.add_argument("--views", choices=["train", "test"], default="train", help="that are fused (default: train)")
    group.add_argument("--device", choices=["cpu", "cuda"], default="cpu", help="that renders them (default: cpu)")
    add_data(group)
    group.add_argument("--threads", type=positive, metavar="N", help="CPU threads (default: all cores)")


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
    from ..export.mesh import write_mesh
    from ..export.meshing import lattice_of, mesh_of
    from ..runs.progress import progress_for_stderr
    from ..runs.trained_folder import read_about, read_trained
    from ..store.atomic import write_atomically
    from ..store.folder import Store
    from ..store.seal import sealed, strict_json
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
    write_atomically(path.with_suffix(".json"), strict_json(sealed(record)))
    for line in told(record["shape"]):
        say(line)
    return 0


def record_of(mesh: "Mesh", scene: "Scene", lattice: "Lattice", views: str) -> dict[str, Any]:
    """What a mesh was made with, in world units, and its distances from the true shape, in shares of the extent."""
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

    from ..scoring.metrics.chamfer import chamfer
    from ..scoring.metrics.surface_distance import surface_distance
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


def told(shape: dict[str, Any]) -> list[str]:
    """The record of a shape in sentences."""
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
        lines.append(f"as Stanford-ORB has it, mean squares in world units: {shape['stanford_orb_chamfer']:.6f}")
    return lines
