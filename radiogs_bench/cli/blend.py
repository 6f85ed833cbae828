"""``radiogs-bench datasets blend``: a .blend file as a scene with complete ground truth, rendered by Blender Cycles."""

import argparse
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radiogs_core.errors import UsageError

from .options import add_verbose, positive

if TYPE_CHECKING:
    from .options import Commands

ENDING = ".blend"


def add_to(actions: "Commands") -> None:
    """Declare the action."""
    parser = actions.add_parser("blend", help="path-trace a .blend file with Cycles ([blend])", allow_abbrev=False)
    parser.set_defaults(command=blend)
    parser.add_argument("file", type=Path, metavar="FILE.blend")
    parser.add_argument("--out", required=True, type=Path, metavar="DIR", help="folder to make")
    parser.add_argument(
        "--lights",
        type=Path,
        metavar="FOLDER",
        help=".hdr, .exr maps, Z up (default: those of the miniatures)",
    )
    parser.add_argument(
        "--training-light", metavar="NAME", help="the map of the training views (default: 'training', or the first)"
    )
    parser.add_argument(
        "--cameras", default="published", metavar="HOW",
        help="'published': NeRF-synthetic's sphere; 'fit': around the scene; or a folder with transforms files",
    )  # fmt: skip
    parser.add_argument("--views", type=positive, default=100, metavar="N", help="training views (default: 100)")
    parser.add_argument("--test", type=positive, default=20, metavar="N", help="test views (default: 20)")
    parser.add_argument("--size", type=positive, default=400, metavar="N", help="pixels a side (default: 400)")
    parser.add_argument("--samples", type=positive, default=256, metavar="N", help="a pixel (default: 256)")
    parser.add_argument("--bounces", type=positive, default=12, metavar="N", help="of light (default: 12)")
    parser.add_argument("--seed", type=int, default=0, help="of the path tracer (default: 0)")
    parser.add_argument("--layout", default="tensoir", help="(default: tensoir; others lack some of the maps)")
    parser.add_argument("--device", choices=("cpu", "cuda"), default="cpu", help="(default: cpu)")
    parser.add_argument("--workers", type=positive, default=1, metavar="N", help="processes (default: 1)")
    parser.add_argument("--keep-passes", action="store_true", help="keep every pass of test views, in DIR.passes")
    add_verbose(parser)


def blend(options: argparse.Namespace) -> int:
    """Render the file into ``--out``, and say what its pictures cannot mean."""
    from radiogs_datasets import load_scene
    from radiogs_datasets.blend.request import Request
    from radiogs_datasets.blend.scene_folder import write_scene
    from radiogs_datasets.lights import OWN_LIGHTS
    from radiogs_datasets.writing import LAYOUTS
    from radiogs_datasets.writing import convert as write

    from ..runs.progress import progress_for_stderr
    from .device import usable_cores
    from .reporter import say

    if options.layout not in LAYOUTS:
        raise UsageError(f"no writer for layout '{options.layout}'", "", f"Writers: {', '.join(LAYOUTS)}.")
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
    """What whoever uses the scene has to know of it, a sentence each."""
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
