"""``radiogs-bench export``: a run's metrics as one table, its training curves, or a trained model in some form."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Group, Parameter

from ..runs.progress import progress_for_stderr
from .options import AS_TRAINED, CodeName, Opening, ProtocolName
from .reporter import say, say_aside
from .values import factor, from_text, positive

if TYPE_CHECKING:
    import torch

Form = Literal["csv", "json", "parquet", "tensorboard", "wandb", "3dgs-ply", "2dgs-ply", "supersplat", "gltf", "obj"]
"""Forms of export: a table of metrics, training curves for a logger, a file of surfels, or a mesh with textures."""

MESH = Group("A model of `train` as a mesh", sort_key=1)
LAYOUT = Group("The test views of a model of `train` as files (docs/protocols.md)", sort_key=1)

Above = Annotated[float, from_text(factor)]


@dataclass(frozen=True)
class Meshing:
    """How a mesh is made."""

    mesh: bool = False
    """Fuse the depth maps of its views, and write the mesh to FOLDER/mesh.ply; with --to gltf or obj to FOLDER/mesh.glb
    or FOLDER/mesh.obj, with textures of base colour and roughness (needs the extra [mesh])."""
    voxel: Above | None = None
    """Make voxels this share of the scene's extent (default: 1/512, or half a pixel if that is larger)."""
    truncation: Above = 4.0
    """Keep distances up to this many voxels from surfaces."""
    memory: Above = 2.0
    """Use at most so many GiB for voxels. Triangles come on top: larger voxels make fewer of them."""
    views: Literal["train", "test"] = "train"
    """Fuse the views of this split."""
    faces: Annotated[int, from_text(positive)] = 40_000
    """Reduce a mesh with textures to at most this many triangles."""
    texels: Annotated[int, from_text(positive)] = 4096
    """Make textures at most about this many texels wide; a texel is half a pixel unless that needs more."""


@dataclass(frozen=True)
class Layout:
    """How test views are written."""

    layout_of: CodeName | None = None
    """Write new views, materials and relit views as this public code does: radiogs, irgs, gs-ir, gi-gs, r3dg, svg-ir,
    tensoir or ptir-gs."""
    bits: Literal[8, 16] = 8
    """Write images of this many bits; the codes write 8."""
    protocol: ProtocolName = "default"
    """Relight with the albedo scale of this metric protocol."""


def export(
    folder: Path,
    /,
    *,
    to: Form | None = None,
    out: Annotated[Path | None, Parameter(name=("--out", "--file"))] = None,
    row: str | None = None,
    meshing: Annotated[Meshing, Parameter(name="*", group=MESH)] = Meshing(),
    layout: Annotated[Layout, Parameter(name="*", group=LAYOUT)] = Layout(),
    opening: Opening = AS_TRAINED,
) -> None:
    """Write a run's metrics, or a trained model, for other programs.

    A run becomes one table or a logger's files, a trained model surfels, a mesh or images.

    Example:  radiogs-bench export out/ablations --to csv

    :param folder: Read the run or the model in this folder.
    :param to: Write metrics (csv, the default, json, parquet), training curves (tensorboard, wandb), surfels (3dgs-ply,
        2dgs-ply, supersplat), or a mesh with textures (gltf, obj).
    :param out: Write to this file or folder (default: FOLDER/export.csv and so on, FOLDER/tensorboard, FOLDER/wandb,
        FOLDER/3dgs.ply, FOLDER/mesh.ply, FOLDER/CODE).
    :param row: Write the surfels of this row of a run (default: the first).
    """
    from radiogs_core.errors import UsageError
    from radiogs_core.surfels.viewer_files import FORMS

    from ..export.mesh_files import SUFFIX

    if to in SUFFIX or meshing.mesh:
        if to not in (None, *SUFFIX):
            raise UsageError(
                f"--mesh and --to {to} ask for two files", "A mesh is written as PLY, gltf or obj.", "Leave one out."
            )
        _mesh(folder, out or folder / f"mesh{SUFFIX.get(str(to), '.ply')}", to, meshing, opening.use())
    elif layout.layout_of is not None:
        _layout(folder, out, layout.layout_of, layout, opening.use())
    elif to is not None and to in FORMS:
        _surfels(folder, out or folder / f"{to.removesuffix('-ply')}.ply", row, to)
    else:
        _run(folder, out, to or "csv")


def _run(folder: Path, out: Path | None, to: str) -> None:
    """Write one table of every metric in the store, or its training curves."""
    from radiogs_core.own_files import own_folder, require_own_folders

    from ..export.loggers import write_event_files, write_wandb_runs
    from ..export.records import export as write
    from ..runs.sweep import read_sweep
    from ..store.folder import Store

    sweep = read_sweep(folder)  # says what to do where there is no run
    store = Store(folder)
    if to == "tensorboard":
        place = out or own_folder(folder / to, folder)
        say(f"{place}: progress of {write_event_files(store, sweep, place)} cells")
    elif to == "wandb":
        place = out or folder
        require_own_folders(place, to)
        count = write_wandb_runs(store, sweep, place)
        say(f"{place / 'wandb'}: progress of {count} cells; send it:  wandb sync {place / 'wandb'}/offline-run-*")
    else:
        path = out or folder / f"export.{to}"
        with progress_for_stderr() as progress:
            count = write(store, path, to, partial(progress.advance, f"reading {folder}"))
        say(f"{path}: {count} values")
        say_aside(store)


def _surfels(folder: Path, path: Path, row: str | None, form: str) -> None:
    """Write the surfels, and print their number."""
    from radiogs_core.errors import DataError
    from radiogs_core.surfels.viewer_files import write_for_viewer

    from ..export.trained_surfels import surfels_in, upwards_in
    from ..store.atomic import explained

    surfels = surfels_in(folder, row)
    if not len(surfels):
        raise DataError(f"the model in '{folder}' has no surfels left", "There is nothing to write.")
    with explained(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_for_viewer(surfels, form, upwards_in(folder, row), path)
    say(f"{path}: {len(surfels)} surfels, colours as on a display")


def _layout(folder: Path, out: Path | None, code: str, by: Layout, device: "torch.device") -> None:
    """Write the test views' files, and print the command that scores them."""
    from radiogs_baselines.outputs.writing import LayoutWriter
    from radiogs_core.own_files import require_own_folders

    from ..export.published_layout import checked, write_as_published
    from ..runs.trained_folder import read_about, read_trained
    from ..scoring.metrics.protocols import protocol
    from ..store.folder import Store

    if out is None:
        require_own_folders(folder, code)
    place = out or folder / code
    with Store(folder).keeping_tracebacks(), progress_for_stderr() as progress:
        about = read_about(folder)
        run, model = read_trained(folder, device)
        written = write_as_published(
            model, run, LayoutWriter(place, checked(code), run.scene, by.bits), about["method"],
            protocol(by.protocol),
            lambda done, total: progress.advance(f"writing {place}", done, total),
        )  # fmt: skip
    say(f"{written} files in {place}")
    say(f"Score them:  radiogs-bench score {place} --scene {about['scene']} --from {code}")


def _mesh(folder: Path, path: Path, form: str | None, by: Meshing, device: "torch.device") -> None:
    """Write the mesh and, beside it, its record as JSON; print its distances from the true shape if known."""
    from ..export.mesh import lattice_of, mesh_of, record_of, sentences_of, write_mesh
    from ..export.mesh_files import require_ready, write_textured
    from ..export.textures import reduced, texel_of, textured, unwrapped
    from ..export.trained_surfels import upwards_in
    from ..runs.trained_folder import read_about, read_trained
    from ..scoring.rendering import prepared
    from ..store.atomic import explained
    from ..store.folder import Store
    from ..store.seal import write_sealed

    if form is not None:
        require_ready(form, path)
    with Store(folder).keeping_tracebacks(), progress_for_stderr() as progress:
        run, model = read_trained(folder, device)
        name, scene = read_about(folder)["method"], run.scene
        lattice = lattice_of(scene, by.voxel, by.truncation)
        shown, views = prepared(name, model), scene.train if by.views == "train" else scene.test
        made = mesh_of(
            shown, views, lattice, int(by.memory * 2**30), partial(progress.advance, "fusing depth maps"),
            device=device, method=name,
        )  # fmt: skip
        painted = ""
        if form is None:
            write_mesh(made, path)
        else:
            say(f"reducing {len(made.faces)} faces")
            made = reduced(made, by.faces)
            say(f"cutting {len(made.faces)} faces into charts")
            shape = unwrapped(made, texel_of(scene, made, by.texels))
            advance = partial(progress.advance, "painting")
            textures = textured(shown, views, shape, lattice, advance, device=device, method=name)
            with explained(path.parent):
                write_textured(textures, form, upwards_in(folder, None), path)
            painted = f", {textures}"
        say(f"{path}: {len(made.vertices)} vertices, {len(made.faces)} faces, voxels of {lattice.voxel:.4g}{painted}")
        record = record_of(made, scene, lattice, by.views)
    write_sealed(path.with_suffix(".json"), record)
    say(*sentences_of(record["shape"]))
