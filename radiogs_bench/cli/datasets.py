"""``radiogs-bench datasets``: list, check and generate scenes, and fetch the weights that scoring needs."""

import argparse
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from radiogs_core.errors import UsageError

from . import blend, fetch
from .options import add_scene_options, add_verbose, names, positive, scene_options

if TYPE_CHECKING:
    from .options import Commands


DATA_EXIT = 3


def add_to(commands: "Commands") -> None:
    """Declare the command and its actions."""
    parser = commands.add_parser("datasets", help="list, check, convert, generate, fetch; weights", allow_abbrev=False)
    actions = parser.add_subparsers(title="actions", required=True, metavar="ACTION")
    listing = actions.add_parser("list", help="scenes that are at hand", allow_abbrev=False)
    listing.set_defaults(command=list_scenes)
    checking = actions.add_parser("check", help="all that is wrong with a scene, at once", allow_abbrev=False)
    checking.set_defaults(command=check)
    checking.add_argument("scene", metavar="PATH", help="scene name or folder")
    add_scene_options(checking)
    checking.add_argument("--json", action="store_true", help="print the findings as JSON")
    converting = actions.add_parser("convert", help="write a scene in another layout", allow_abbrev=False)
    converting.set_defaults(command=convert)
    converting.add_argument("scene", metavar="PATH", help="scene name or folder")
    converting.add_argument("--to", required=True, metavar="LAYOUT", help="tensoir, synthetic4relight or blender")
    converting.add_argument("--out", required=True, type=Path, metavar="DIR", help="folder to make")
    converting.add_argument("--every", type=positive, default=1, metavar="N", help="keep every Nth view (default: 1)")
    add_scene_options(converting)
    generating = actions.add_parser("generate", help="path-trace miniature scenes ([generate])", allow_abbrev=False)
    generating.set_defaults(command=generate)
    generating.add_argument("names", nargs="+", metavar="NAME")
    generating.add_argument("--out", type=Path, default=Path("out/scenes"), metavar="DIR", help="(default: out/scenes)")
    generating.add_argument("--layout", default="tensoir", help="(default: tensoir; others lack some of the maps)")
    generating.add_argument("--seed", type=int, default=0, help="of the path tracer (default: 0)")
    generating.add_argument("--size", type=positive, default=96, metavar="N", help="pixels a side (default: 96)")
    generating.add_argument("--train", type=positive, default=48, metavar="N", help="training views (default: 48)")
    generating.add_argument("--test", type=positive, default=8, metavar="N", help="test views (default: 8)")
    generating.add_argument("--depth", type=positive, default=8, metavar="N", help="of light paths (default: 8)")
    generating.add_argument(
        "--samples", type=positive, default=256, metavar="N", help="paths a pixel of a training view (default: 256)"
    )
    fetching = actions.add_parser("weights", help="fetch the published weights of LPIPS", allow_abbrev=False)
    fetching.set_defaults(command=weights)
    fetching.add_argument("--to", type=Path, metavar="DIR", help="(default: where they are looked for)")
    fetching.add_argument("--nets", type=names, metavar="NET,...", help="(default: alex,vgg,squeeze; 0.8 GB)")
    for action in (listing, checking, converting, generating, fetching):
        add_verbose(action)
    blend.add_to(actions)
    fetch.add_to(actions)


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

    from radiogs_datasets.check import check_scene

    from ..runs.progress import progress_for_stderr
    from .reporter import say, say_whole

    with progress_for_stderr() as progress:
        report = check_scene(options.scene, scene_options(options), partial(progress.advance, "checking"))
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
        say(f"maps of the test views: {', '.join(maps)}")
        say(f"lights: {', '.join(sorted(scene.lights)) or 'none'}")
        say(f"checksum: {scene.checksum}")
    say("sound" if report.sound else "not usable as it is")
    return 0 if report.sound else DATA_EXIT


def convert(options: argparse.Namespace) -> int:
    """Write a scene in another layout, and say what that layout cannot carry."""
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
        raise UsageError(f"no writer for layout '{options.layout}'", "", f"Writers: {', '.join(LAYOUTS)}.")
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
