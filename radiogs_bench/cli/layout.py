"""``radiogs-bench export --layout-of CODE``: a trained model's test views as that public code writes its own."""

import argparse
from typing import TYPE_CHECKING

from .device import chosen_device

if TYPE_CHECKING:
    from pathlib import Path


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--layout-of`` and what belongs to it; device and data are those of ``mesh.add_options``."""
    group = parser.add_argument_group("the test views of a model that `train` made, as files (docs/scoring.md)")
    group.add_argument(
        "--layout-of", metavar="CODE",
        help="write new views, materials and relit views as this public code does: radiogs, irgs, gs-ir, gi-gs, r3dg,"
        " svg-ir, tensoir",
    )  # fmt: skip
    group.add_argument("--bits", type=int, choices=[8, 16], default=8, help="of these files (default: 8, as they have)")
    group.add_argument(
        "--protocol", default="default", help="whose factor of the albedo relit views have (default: default)"
    )


def export_layout(options: argparse.Namespace) -> int:
    """Write the files into OUT/CODE, or into the folder of --file, and say how they are scored."""
    from radiogs_baselines.outputs import LayoutWriter

    from ..export.published_layout import checked, write_as_published
    from ..runs.progress import progress_for_stderr
    from ..runs.trained_folder import read_about, read_trained
    from ..scoring.metrics import protocol
    from ..store.folder import Store
    from .reporter import say

    folder: Path = options.file or options.out / options.layout_of
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
