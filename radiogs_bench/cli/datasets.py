"""``radiogs-bench datasets``: list, check, convert and make scenes; fetch public data sets and the weights of LPIPS."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, Parameter

from radiogs_core.errors import UsageError
from radiogs_datasets.options import AS_STORED

from ..runs.progress import progress_for_stderr
from .options import OPTIONS, Count, Data, DataSetName, Device, Json, Names, Opened, SceneName
from .reporter import complain, say, say_whole, show

if TYPE_CHECKING:
    from ..fetching.catalogue import DataSet


DATA_EXIT = 3

datasets = App(
    name="datasets",
    group_parameters=OPTIONS,
    help="""List, check, convert, make and fetch scenes, and fetch the weights of LPIPS.

    Example:  radiogs-bench datasets check path/to/scene
    """,
)

Layout = Annotated[
    Literal["tensoir", "synthetic4relight", "blender"],
    Parameter(help="Write this layout; those other than tensoir lack some of the maps."),
]


@datasets.command(name="list")
def list_scenes(*, as_json: Json = False) -> None:
    """List the scenes that come with the package: kind, size, maker, licence, and whether settings were tuned on them.

    Example:  radiogs-bench datasets list

    :param as_json: Print a JSON object by the scenes' names.
    """
    from rich.table import Table

    from radiogs_datasets.data_root import scene_folders

    scenes = {name: listed(folder) for name, folder in scene_folders().items()}
    if as_json:
        say_whole(json.dumps(scenes, indent=1))
        return
    table = Table("name", "kind", "views", "pixels", "MB", "maker", "licence", "settings", "the BRDF cannot represent")
    for name, about in scenes.items():
        table.add_row(name, *(str(value) for value in about.values()))
    show(table)


def listed(folder: Path) -> dict[str, str | float]:
    """The facts that the list shows of a scene: texts of its metadata, and its size."""
    from PIL import Image

    about, train, test = (
        json.loads((folder / f"{name}.json").read_text())
        for name in ("metadata", "transforms_train", "transforms_test")
    )
    with Image.open(folder / "test_000" / "rgba.png") as image:
        width, height = image.size
    return {
        "kind": about["kind"],
        "views": f"{len(train['frames'])} + {len(test['frames'])}",
        "pixels": f"{width} x {height}",
        "megabytes": round(sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6, 1),
        "maker": about.get("maker", "this project"),
        "licence": about.get("licence", "Apache-2.0"),
        "choices": about["choices"],
        "not_represented": about.get("not_represented", ""),
    }


@datasets.command
def check(
    scene: SceneName, /, *, deep: bool = False, as_json: Json = False, data: Data = None, opened: Opened = AS_STORED
) -> int:
    """Print everything that is wrong with a scene, and what it holds; the exit code is 3 if it cannot be used.

    Example:  radiogs-bench datasets check path/to/scene --json

    :param scene: Check this scene, by name or folder.
    :param deep: Also hold cameras, images, maps and lights against one another (up to a minute or two).
    :param as_json: Print the findings as JSON.
    """
    from radiogs_datasets import scene_choices, scene_kind
    from radiogs_datasets.check import check_scene

    with progress_for_stderr() as progress:
        report = check_scene(scene, opened, partial(progress.advance, "checking"), deep)
    code, found = 0 if report.sound else DATA_EXIT, report.scene
    if as_json:
        findings = [asdict(finding) for finding in report.findings]
        say_whole(json.dumps({"scene": scene, "sound": report.sound, "findings": findings}, indent=1))
        return code
    for finding in report.findings:
        say(f"{finding.severity}: {finding.place}: {finding.what}")
    if found is not None:
        maps = sorted({name for view in found.test for name in view.sources})
        say(f"{found.name}: layout {found.layout}, {len(found.train)} training and {len(found.test)} test views")
        if (kind := scene_kind(scene)) is not None:
            chosen = "no setting" if scene_choices(scene) == "reported only" else "settings"
            say(f"kind of scene: {kind}; {chosen} of this project may be chosen by its results")
        say(f"maps of the test views: {', '.join(maps)}")
        say(f"lights: {', '.join(sorted(found.lights)) or 'none'}")
        say(f"checksum: {found.checksum}")
    say("sound" if report.sound else "not usable as it is")
    return code


@datasets.command
def pose(
    photos: Path,
    /,
    *,
    matching: Literal["auto", "exhaustive", "sequential"] = "auto",
    mask_folder: Path | None = None,
    threads: Count | None = None,
) -> None:
    """Find the camera poses of photographs by COLMAP, and write them to sparse/ beside them (needs the extra [poses]).

    Example:  radiogs-bench datasets pose path/to/capture

    :param photos: Pose the photos in this folder, or in its folder images/. A run that was stopped goes on.
    :param matching: Match all pairs of photos, or neighbours in the order of names, as for a video
        (default: all up to 100 photos).
    :param mask_folder: Use no feature where the masks in this folder are black (default: masks/ beside the photos).
    :param threads: Use N CPU threads (default: as many as there are cores).
    """
    from radiogs_datasets.posing import pose_photos

    from ..device import usable_cores
    from ..extras import extra_library

    colmap = extra_library("pycolmap", "`datasets pose` needs pycolmap", "poses")
    with progress_for_stderr() as progress:
        found = pose_photos(photos, colmap, matching, mask_folder, threads or usable_cores(), progress.advance)
    registered = found.photos - len(found.unregistered)
    say(f"{found.scene}/sparse/0: {registered} of {found.photos} photos have poses, {found.points} points")
    say(f"reprojection error: {found.error:.2f} pixels in the mean")
    if found.unregistered:
        say(f"without a pose: {', '.join(found.unregistered)}")
    if found.others:
        counts = ", ".join(map(str, found.others))
        say(f"the largest of {1 + len(found.others)} models is kept; the others had {counts} photos")
    masks = "" if found.masks is None else f" --mask-folder {found.masks}"
    say(f"Train on it:  radiogs-bench train {found.scene}{masks} --long-side 400")


@datasets.command
def convert(
    scene: SceneName, /, *, to: Layout, out: Path, every: Count = 1, data: Data = None, opened: Opened = AS_STORED
) -> None:
    """Write a scene in another layout, and print what that layout cannot hold.

    Example:  radiogs-bench datasets convert corner --to blender --out out/corner

    :param scene: Convert this scene, by name or folder.
    :param out: Make this folder.
    :param every: Keep every Nth view.
    """
    from radiogs_datasets import load_scene
    from radiogs_datasets.reduction import every as every_nth
    from radiogs_datasets.writing import convert as write

    read = every_nth(load_scene(scene, options=opened), every)
    with progress_for_stderr() as progress:
        lost = write(read, out, to, partial(progress.advance, "converting"))
    say(*read.repairs, *lost)
    say(f"{out}: {len(read.train)} training and {len(read.test)} test views, layout {to}")


@dataclass(frozen=True)
class Pictured:
    """Options of a generated scene's views and light paths; the fields of ``radiogs_datasets.generate.Pictures``."""

    size: Count = 96
    """Render N pixels on each side."""
    train: Count | None = None
    """Render N training views (default: as many as the recipe has)."""
    test: Count = 8
    """Render N test views."""
    depth: Count = 8
    """Follow light over N segments."""
    samples: Count = 256
    """Trace N paths for each pixel of a training view."""


@datasets.command
def generate(
    *recipes: str,
    out: Path = Path("out/scenes"),
    layout: Layout = "tensoir",
    seed: int = 0,
    pictured: Annotated[Pictured, Parameter(name="*")] = Pictured(),
) -> None:
    """Path-trace generated scenes (needs the extra [generate]).

    Example:  radiogs-bench datasets generate corner --size 64 --samples 64

    :param recipes: Make the scenes of these recipes.
    :param out: Make the scenes' folders in this one.
    :param seed: Seed the path tracer with this.
    """
    from radiogs_datasets.generate import Pictures, generate_scene

    if not recipes:
        raise UsageError("no scene was named", "", "Name a recipe:  radiogs-bench datasets generate corner")
    for name in recipes:
        with _in_layout(out / name, layout) as made, progress_for_stderr() as progress:
            generate_scene(name, made, seed, progress.advance, Pictures(**vars(pictured)))
        say(f"{name}: {out / name}")


@contextmanager
def _in_layout(folder: Path, layout: str) -> Iterator[Path]:
    """The folder to make a scene in; then write it in the wanted layout, and print what that layout cannot hold."""
    from radiogs_datasets import load_scene
    from radiogs_datasets.writing import convert as write

    made = folder if layout == "tensoir" else folder.with_name(f"{folder.name}.tensoir")
    yield made
    if made != folder:
        say(*write(load_scene(str(made)), folder, layout))


@datasets.command
def weights(*, to: Path | None = None, nets: Names = ()) -> None:
    """Fetch the published weights of LPIPS, and check them.

    Example:  radiogs-bench datasets weights --nets alex

    :param to: Write to this folder (default: the one where they are looked for).
    :param nets: Fetch these networks (default: alex,vgg,squeeze, 0.8 GB).
    """
    from ..fetching.lpips_weights import fetch as fetch_weights
    from ..fetching.lpips_weights import sources
    from ..scoring.metrics.weights import WEIGHTS_VARIABLE, weights_folder

    folder = to or weights_folder()
    for source in sources(nets or None):
        with progress_for_stderr() as progress:
            fetched = fetch_weights(source, folder, partial(progress.advance, source.name))
        say(f"{folder / source.name}: {'fetched from ' + source.url if fetched else 'is there'}")
    if folder != weights_folder():
        say(f"Use them:  export {WEIGHTS_VARIABLE}={folder}")


@dataclass(frozen=True)
class Rendered:
    """Options of the rendering of a .blend file; the fields of ``radiogs_datasets.blend.request.Request``."""

    lights: Path | None = None
    """Light the scene by the .hdr and .exr maps in this folder, Z up (default: the generated scenes' maps)."""
    training_light: str | None = None
    """Light the training views by this map (default: 'training', else the first)."""
    cameras: str = "published"
    """Place cameras on NeRF-synthetic's sphere ('published'), around the scene ('fit'), or as in a folder's transforms
    files."""
    train: Annotated[Count, Parameter(name="--views")] = 100
    """Render N training views."""
    test: Count = 20
    """Render N test views."""
    size: Count = 400
    """Render N pixels on each side."""
    samples: Count = 256
    """Trace N paths for each pixel."""
    bounces: Count = 12
    """Follow light over N bounces."""
    seed: int = 0
    """Seed the path tracer with this."""
    device: Device = "cpu"
    """Render on this device."""
    keep_passes: bool = False
    """Keep every pass of the test views, in OUT.passes."""


@datasets.command
def blend(
    file: Path,
    /,
    *,
    out: Path,
    layout: Layout = "tensoir",
    workers: Count = 1,
    rendered: Annotated[Rendered, Parameter(name="*")] = Rendered(),
) -> None:
    """Path-trace a .blend file with Blender's Cycles (needs the extra [blend]).

    Example:  radiogs-bench datasets blend scene.blend --out out/scene --size 200

    :param file: Render the scene in this file.
    :param out: Make this folder.
    :param workers: Render in N processes.
    """
    from radiogs_datasets.blend.request import Request
    from radiogs_datasets.blend.scene_folder import write_scene
    from radiogs_datasets.lights import OWN_LIGHTS

    from ..device import usable_cores

    request = Request(file, **{**vars(rendered), "lights": rendered.lights or OWN_LIGHTS})
    threads = max(1, usable_cores() // workers)
    with _in_layout(out, layout) as made:
        with progress_for_stderr() as progress:
            metadata = write_scene(request, made, workers, threads, partial(progress.advance, "rendering"))
        say(*remarks(metadata))
    say(f"{out}: {layout}, rendered by Blender {metadata['versions']['blender']}")


def remarks(metadata: dict[str, Any]) -> Iterator[str]:
    """Yield sentences that users of a scene rendered by Blender have to know: noise, light left out, materials."""
    if metadata["noise_floor_db"] is not None:
        yield f"noise: {metadata['noise_floor_db']:.1f} dB between two seeds of the first test view, in display colour"
    yield f"indirect light: {metadata['indirect_share']:.1%} of what the test views show"
    yield f"light beyond {metadata['bounces']} bounces: {metadata['energy_beyond_bounces']:.2%} (left out)"
    for name, share in metadata["energy_of_what_the_brdf_cannot_say"].items():
        yield f"{share:.1%} of the light comes from surfaces with '{name.replace('_', ' ')}', unknown to the BRDF"
    for kind, count in metadata["materials_not_understood"].items():
        yield f"materials with {kind}: {count}; their albedo is Blender's diffuse colour, and no roughness is written"
    opened = metadata["opened"]
    counted = {
        "scripts": "scripts and Python drivers, not run", "lamps": "lamps, switched off: the map is the light",
        "volumes": "volumes, in the images and in no map", "other_scenes": "other scenes of the file, left out",
    }  # fmt: skip
    yield from (f"{said}: {opened[name]}" for name, said in counted.items() if opened[name])
    nothing = metadata["views_of_nothing"]
    if nothing:
        yield f"views that show nothing: {len(nothing)} ({', '.join(nothing[:5])})"


@datasets.command
def fetch(*data_sets: DataSetName, root: Annotated[Path | None, Parameter(name="--data")] = None) -> None:
    """Download public data sets; without a name, list them.

    Example:  radiogs-bench datasets fetch tensoir --data path/to/data

    :param data_sets: Download these data sets.
    :param root: Fill this folder (default: the variable RADIOGS_BENCH_DATA).
    """
    from radiogs_datasets.data_root import DATA_VARIABLE, data_root

    from ..errors import NotFetched
    from ..fetching.catalogue import DATA_SETS, data_set
    from ..fetching.fetch import fetch_data_set

    if not data_sets:
        for each in DATA_SETS.values():
            say(*described(each))
        return
    wanted = [data_set(name) for name in data_sets]
    place = root or data_root()
    if place is None:
        raise UsageError(
            "no folder was named for the data", f"The variable {DATA_VARIABLE} is not set.", "Add --data ROOT."
        )
    lacking: list[NotFetched] = []
    for each in wanted:
        say(f"{each.title} ({each.page}; terms: {each.licence})")
        try:
            with progress_for_stderr() as progress:
                fetch_data_set(each, place, progress.advance, say)
        except NotFetched as error:
            lacking.append(error)
            continue
        say(f"{place / each.name} is complete (terms: {each.licence})")
    if place != data_root():
        say(f"Use it:  --data {place}   or   export {DATA_VARIABLE}={place.resolve()}")
    for other in lacking[:-1]:
        complain(f"{other}")
    if lacking:
        raise lacking[-1]


def described(of: "DataSet") -> list[str]:
    """A data set in a few lines: its page, its terms, and its files with their sizes and checksums."""
    lines = [f"{of.name}: {of.title}", f"  page: {of.page}", f"  terms: {of.licence}"]
    for piece in of.pieces:
        size = f"{piece.bytes / 1e9:.1f} GB" if piece.bytes else "size not published"
        checked = f"SHA-256 {piece.sha256[:8]}..." if piece.sha256 else "checksum unknown: recorded at first download"
        how = "; by hand" if piece.by_hand else ""
        lines.append(f"  {piece.url} -> {of.name}/{piece.name} ({size}; {checked}{how})")
    return lines
