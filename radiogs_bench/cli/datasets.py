"""``radiogs-bench datasets``: list, check, convert and make scenes; fetch public data sets and the weights of LPIPS.

``blend`` and ``fetch`` declare their options beside what they do, at the end. ``generate`` and ``blend`` make scenes
with complete ground truth: the former path-traces miniatures, the latter renders a .blend file with Blender Cycles.
"""

import argparse
from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radiogs_core.errors import UsageError, unknown

from .options import add_scene_options, add_verbose, declare, names, positive, scene_options

if TYPE_CHECKING:
    from ..fetching.catalogue import DataSet
    from .options import Commands


DATA_EXIT = 3


def add_to(commands: "Commands") -> None:
    """Declare the command and its actions."""
    parser = declare(
        commands, "datasets", "List, check, convert, make and fetch scenes, and fetch the weights of LPIPS.",
        "datasets check path/to/scene",
    )  # fmt: skip
    actions = parser.add_subparsers(title="actions", required=True, metavar="ACTION")
    listing = declare(actions, "list", "List the scenes that come with the package.", "datasets list")
    listing.set_defaults(command=list_scenes)
    checking = declare(
        actions, "check", "Print everything that is wrong with a scene.", "datasets check path/to/scene --json"
    )
    checking.set_defaults(command=check)
    checking.add_argument("scene", metavar="PATH", help="Check this scene, by name or folder.")
    add_scene_options(checking)
    checking.add_argument(
        "--deep", action="store_true",
        help="Also hold cameras, images, maps and lights against one another (up to a minute or two).",
    )  # fmt: skip
    checking.add_argument("--json", action="store_true", help="Print the findings as JSON.")
    converting = declare(
        actions, "convert", "Write a scene in another layout.", "datasets convert corner --to blender --out out/corner"
    )
    converting.set_defaults(command=convert)
    converting.add_argument("scene", metavar="PATH", help="Convert this scene, by name or folder.")
    converting.add_argument(
        "--to", required=True, metavar="LAYOUT", help="Write this layout: tensoir, synthetic4relight or blender."
    )
    converting.add_argument("--out", required=True, type=Path, metavar="DIR", help="Make this folder.")
    converting.add_argument("--every", type=positive, default=1, metavar="N", help="Keep every Nth view (default: 1).")
    add_scene_options(converting)
    generating = _add_generate(actions)
    fetching = declare(actions, "weights", "Fetch the published weights of LPIPS.", "datasets weights --nets alex")
    fetching.set_defaults(command=weights)
    fetching.add_argument(
        "--to", type=Path, metavar="DIR", help="Write to this folder (default: the one where they are looked for)."
    )
    fetching.add_argument(
        "--nets", type=names, metavar="NET,...", help="Fetch these networks (default: alex,vgg,squeeze, 0.8 GB)."
    )
    for action in (listing, checking, converting, generating, fetching):
        add_verbose(action)
    _add_blend(actions)
    _add_fetch(actions)


LAYOUT_HELP = "Write this layout (default: tensoir; the others lack some of the maps)."


def _add_generate(actions: "Commands") -> argparse.ArgumentParser:
    """Declare the action ``generate``."""
    parser = declare(
        actions, "generate", "Path-trace generated scenes (needs the extra [generate]).",
        "datasets generate corner --size 64 --samples 64",
    )  # fmt: skip
    parser.set_defaults(command=generate)
    parser.add_argument("names", nargs="+", metavar="NAME", help="Make the scenes of these recipes.")
    parser.add_argument(
        "--out", type=Path, default=Path("out/scenes"), metavar="DIR",
        help="Make the scenes' folders in this one (default: out/scenes).",
    )  # fmt: skip
    parser.add_argument("--layout", default="tensoir", help=LAYOUT_HELP)
    parser.add_argument("--seed", type=int, default=0, help="Seed the path tracer with this (default: 0).")
    parser.add_argument(
        "--size", type=positive, default=96, metavar="N", help="Render N pixels on each side (default: 96)."
    )
    parser.add_argument(
        "--train", type=positive, metavar="N", help="Render N training views (default: as many as the recipe has)."
    )
    parser.add_argument("--test", type=positive, default=8, metavar="N", help="Render N test views (default: 8).")
    parser.add_argument(
        "--depth", type=positive, default=8, metavar="N", help="Follow light over N segments (default: 8)."
    )
    parser.add_argument(
        "--samples", type=positive, default=256, metavar="N",
        help="Trace N paths for each pixel of a training view (default: 256).",
    )  # fmt: skip
    return parser


def list_scenes(options: argparse.Namespace) -> int:
    """Print the names of the available scenes."""
    from radiogs_datasets import scene_names

    from .reporter import say

    for name in scene_names():
        say(name)
    return 0


def check(options: argparse.Namespace) -> int:
    """Print everything that is wrong with a scene, and its contents; the exit code is 3 if it cannot be used."""
    import json

    from radiogs_datasets import scene_choices, scene_kind
    from radiogs_datasets.check import check_scene

    from ..runs.progress import progress_for_stderr
    from .reporter import say, say_whole

    with progress_for_stderr() as progress:
        told = partial(progress.advance, "checking")
        report = check_scene(options.scene, scene_options(options), told, options.deep)
    scene = report.scene
    if options.json:
        found = [asdict(finding) for finding in report.findings]
        say_whole(json.dumps({"scene": options.scene, "sound": report.sound, "findings": found}, indent=1))
        return 0 if report.sound else DATA_EXIT
    for finding in report.findings:
        say(f"{finding.severity}: {finding.place}: {finding.what}")
    if scene is not None:
        maps = sorted({name for view in scene.test for name in view.sources})
        say(f"{scene.name}: layout {scene.layout}, {len(scene.train)} training and {len(scene.test)} test views")
        if (kind := scene_kind(options.scene)) is not None:
            chosen = "no setting" if scene_choices(options.scene) == "reported only" else "settings"
            say(f"kind of scene: {kind}; {chosen} of this project may be chosen by its results")
        say(f"maps of the test views: {', '.join(maps)}")
        say(f"lights: {', '.join(sorted(scene.lights)) or 'none'}")
        say(f"checksum: {scene.checksum}")
    say("sound" if report.sound else "not usable as it is")
    return 0 if report.sound else DATA_EXIT


def convert(options: argparse.Namespace) -> int:
    """Write a scene in another layout, and print what that layout cannot hold."""
    from radiogs_datasets import load_scene
    from radiogs_datasets.reduction import every
    from radiogs_datasets.writing import convert as write

    from ..runs.progress import progress_for_stderr
    from .reporter import say

    scene = every(load_scene(options.scene, options=scene_options(options)), options.every)
    with progress_for_stderr() as progress:
        lost = write(scene, options.out, options.to, partial(progress.advance, "converting"))
    for line in (*scene.repairs, *lost):
        say(line)
    say(f"{options.out}: {len(scene.train)} training and {len(scene.test)} test views, layout {options.to}")
    return 0


def generate(options: argparse.Namespace) -> int:
    """Path-trace scenes into folders below ``--out``."""
    from radiogs_datasets import load_scene
    from radiogs_datasets.generate import Pictures, generate_scene
    from radiogs_datasets.writing import LAYOUTS
    from radiogs_datasets.writing import convert as write

    from ..runs.progress import progress_for_stderr
    from .reporter import say

    if options.layout not in LAYOUTS:
        raise unknown("layout to write", options.layout, LAYOUTS)
    pictures = Pictures(options.size, options.train, options.test, options.depth, options.samples)
    for name in options.names:
        folder = options.out / name
        made = folder if options.layout == "tensoir" else options.out / f"{name}.tensoir"
        with progress_for_stderr() as progress:
            generate_scene(name, made, options.seed, progress.advance, pictures)
        if made != folder:
            for line in write(load_scene(str(made)), folder, options.layout):
                say(line)
        say(f"{name}: {folder}")
    return 0


def weights(options: argparse.Namespace) -> int:
    """Download missing LPIPS backbones and heads, and check them."""
    from ..fetching.lpips_weights import fetch as fetch_weights
    from ..fetching.lpips_weights import sources
    from ..runs.progress import progress_for_stderr
    from ..scoring.metrics.weights import WEIGHTS_VARIABLE, weights_folder
    from .reporter import say

    folder = options.to or weights_folder()
    for source in sources(options.nets):
        with progress_for_stderr() as progress:
            fetched = fetch_weights(source, folder, partial(progress.advance, source.name))
        say(f"{folder / source.name}: {'fetched from ' + source.url if fetched else 'is there'}")
    if folder != weights_folder():
        say(f"Use them:  export {WEIGHTS_VARIABLE}={folder}")
    return 0


def _add_fetch(actions: "Commands") -> None:
    """Declare the action ``fetch``."""
    parser = declare(
        actions, "fetch", "Download public data sets; without a name, list them.",
        "datasets fetch tensoir --data path/to/data",
    )  # fmt: skip
    parser.set_defaults(command=fetch)
    parser.add_argument("names", nargs="*", metavar="NAME", help="Download these data sets.")
    # Not ``data``, which has to be a folder before a command begins: this one makes it.
    parser.add_argument(
        "--data", dest="root", type=Path, metavar="ROOT",
        help="Fill this folder (default: the variable RADIOGS_BENCH_DATA).",
    )  # fmt: skip
    add_verbose(parser)


def fetch(options: argparse.Namespace) -> int:
    """Fetch each data set into ``ROOT/NAME``; at the end, print which files have to be fetched by hand."""
    from radiogs_datasets.data_root import DATA_VARIABLE, data_root

    from ..errors import NotFetched
    from ..fetching.catalogue import DATA_SETS, data_set
    from ..fetching.fetch import fetch_data_set
    from ..runs.progress import progress_for_stderr
    from .reporter import complain, say

    if not options.names:
        for each in DATA_SETS.values():
            for line in described(each):
                say(line)
        return 0
    wanted = [data_set(name) for name in options.names]
    root = options.root or data_root()
    if root is None:
        raise UsageError(
            "no folder was named for the data", f"The variable {DATA_VARIABLE} is not set.", "Add --data ROOT."
        )
    lacking: list[NotFetched] = []
    for each in wanted:
        say(f"{each.title} ({each.page}; terms: {each.licence})")
        try:
            with progress_for_stderr() as progress:
                fetch_data_set(each, root, progress.advance, say)
        except NotFetched as error:
            lacking.append(error)
            continue
        say(f"{root / each.name} is complete")
    if root != data_root():
        say(f"Use it:  --data {root}   or   export {DATA_VARIABLE}={root.resolve()}")
    for other in lacking[:-1]:
        complain(f"{other}")
    if lacking:
        raise lacking[-1]
    return 0


def described(of: "DataSet") -> list[str]:
    """A data set in a few lines: its page, its terms, and its files with their sizes and checksums."""
    lines = [f"{of.name}: {of.title}", f"  page: {of.page}", f"  terms: {of.licence}"]
    for piece in of.pieces:
        size = f"{piece.bytes / 1e9:.1f} GB" if piece.bytes else "size not published"
        checked = f"SHA-256 {piece.sha256[:8]}..." if piece.sha256 else "checksum unknown: recorded at first download"
        how = "; by hand" if piece.by_hand else ""
        lines.append(f"  {piece.url} -> {of.name}/{piece.name} ({size}; {checked}{how})")
    return lines


def _add_blend(actions: "Commands") -> None:
    """Declare the action ``blend``."""
    parser = declare(
        actions, "blend", "Path-trace a .blend file with Blender's Cycles (needs the extra [blend]).",
        "datasets blend scene.blend --out out/scene --size 200",
    )  # fmt: skip
    parser.set_defaults(command=blend)
    parser.add_argument("file", type=Path, metavar="FILE.blend", help="Render the scene in this file.")
    parser.add_argument("--out", required=True, type=Path, metavar="DIR", help="Make this folder.")
    parser.add_argument(
        "--lights", type=Path, metavar="FOLDER",
        help="Light the scene by the .hdr and .exr maps in FOLDER, Z up (default: those of the generated scenes).",
    )  # fmt: skip
    parser.add_argument(
        "--training-light", metavar="NAME",
        help="Light the training views by this map (default: 'training', else the first).",
    )  # fmt: skip
    parser.add_argument(
        "--cameras", default="published", metavar="HOW",
        help="Place cameras on NeRF-synthetic's sphere ('published'), around the scene ('fit'), or as the transforms"
        " files in a folder say (default: published).",
    )  # fmt: skip
    parser.add_argument(
        "--views", type=positive, default=100, metavar="N", help="Render N training views (default: 100)."
    )
    parser.add_argument("--test", type=positive, default=20, metavar="N", help="Render N test views (default: 20).")
    parser.add_argument(
        "--size", type=positive, default=400, metavar="N", help="Render N pixels on each side (default: 400)."
    )
    parser.add_argument(
        "--samples", type=positive, default=256, metavar="N", help="Trace N paths for each pixel (default: 256)."
    )
    parser.add_argument(
        "--bounces", type=positive, default=12, metavar="N", help="Follow light over N bounces (default: 12)."
    )
    parser.add_argument("--seed", type=int, default=0, help="Seed the path tracer with this (default: 0).")
    parser.add_argument("--layout", default="tensoir", help=LAYOUT_HELP)
    parser.add_argument(
        "--device", choices=("cpu", "cuda"), default="cpu", help="Render on this device (default: cpu)."
    )
    parser.add_argument("--workers", type=positive, default=1, metavar="N", help="Render in N processes (default: 1).")
    parser.add_argument("--keep-passes", action="store_true", help="Keep every pass of the test views, in DIR.passes.")
    add_verbose(parser)


def blend(options: argparse.Namespace) -> int:
    """Render a .blend file into ``--out``, and print what users of the scene have to know."""
    from radiogs_datasets import load_scene
    from radiogs_datasets.blend.request import Request
    from radiogs_datasets.blend.scene_folder import write_scene
    from radiogs_datasets.lights import OWN_LIGHTS
    from radiogs_datasets.writing import LAYOUTS
    from radiogs_datasets.writing import convert as write

    from ..device import usable_cores
    from ..runs.progress import progress_for_stderr
    from .reporter import say

    if options.layout not in LAYOUTS:
        raise unknown("layout to write", options.layout, LAYOUTS)
    request = Request(
        options.file, options.lights or OWN_LIGHTS, options.training_light, options.cameras, options.views,
        options.test, options.size, options.samples, options.bounces, options.seed, options.device,
        options.keep_passes,
    )  # fmt: skip
    made = options.out if options.layout == "tensoir" else options.out.with_name(f"{options.out.name}.tensoir")
    threads = max(1, usable_cores() // options.workers)
    with progress_for_stderr() as progress:
        metadata = write_scene(request, made, options.workers, threads, partial(progress.advance, "rendering"))
    for line in remarks(metadata):
        say(line)
    if made != options.out:
        for line in write(load_scene(str(made)), options.out, options.layout):
            say(line)
    say(f"{options.out}: {options.layout}, rendered by Blender {metadata['versions']['blender']}")
    return 0


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
