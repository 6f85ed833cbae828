"""``radiogs-bench datasets``: list, check and generate scenes."""

import argparse
from functools import partial


def list_scenes(options: argparse.Namespace) -> int:
    """Print the names of the scenes that are at hand."""
    from radiogs_datasets import scene_names

    from .reporter import say

    for name in scene_names():
        say(name)
    return 0


def check(options: argparse.Namespace) -> int:
    """Read every file of a scene and print what it holds; raises DataError for the first damaged one."""
    from radiogs_datasets import load_scene

    from ..preflight import read_everything
    from ..progress import progress_for_stderr
    from .reporter import say

    scene = load_scene(options.scene)
    with progress_for_stderr() as progress:
        read_everything(scene, partial(progress.advance, "reading"))
    maps = sorted({name for view in scene.test for name in view.sources})
    say(f"{scene.name}: layout {scene.layout}, {len(scene.train)} training and {len(scene.test)} test views")
    say(f"maps of the test views: {', '.join(maps)}")
    say(f"lights: {', '.join(sorted(scene.lights)) or 'none'}")
    say(f"checksum: {scene.checksum}")
    return 0


def generate(options: argparse.Namespace) -> int:
    """Path-trace scenes into folders below ``--out``."""
    from radiogs_datasets.generate import generate_scene

    from ..progress import progress_for_stderr
    from .reporter import say

    for name in options.names:
        folder = options.out / name
        with progress_for_stderr() as progress:
            generate_scene(name, folder, options.seed, progress.advance)
        say(f"{name}: {folder}")
    return 0
