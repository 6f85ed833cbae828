"""``radiogs-bench export --to 3dgs-ply``, ``2dgs-ply`` or ``supersplat``: surfels as another program reads them."""

import argparse
from pathlib import Path

FORMS = ("3dgs-ply", "2dgs-ply", "supersplat")
"""Those of ``radiogs_core.surfels.viewer_files``, which takes too long to import for `--help`."""


def export_splats(options: argparse.Namespace) -> int:
    """Write OUT/FORM.ply, or the file of --file, and say how many surfels it has."""
    import torch

    from radiogs_core.errors import DataError
    from radiogs_core.surfels.viewer_files import write_for_viewer

    from ..export.trained_surfels import standpoint_in, surfels_in
    from ..store.atomic import explained
    from .reporter import say

    surfels = surfels_in(options.out, options.row)
    if not len(surfels):
        raise DataError(f"the model in '{options.out}' has no surfels left", "There is nothing to write.")
    seen_from = standpoint_in(options.out, options.row)
    up = torch.tensor([0.0, 0.0, 1.0]) if seen_from is None else seen_from.up
    path: Path = options.file or options.out / f"{options.to.removesuffix('-ply')}.ply"
    with explained(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_for_viewer(surfels, options.to, up, path)
    say(f"{path}: {len(surfels)} surfels, colours as on a display")
    return 0
