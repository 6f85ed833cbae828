"""``radiogs-bench probe``: what a scene, or a trained model, calls for, with evidence."""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from .options import add_verbose, positive

if TYPE_CHECKING:
    from collections.abc import Sequence

    from radiogs.effects.decide.probe import Findings
    from radiogs.effects.measure.subject import Subject

    from .options import Commands

MATTERS = 0.1
"""Change of a pixel's display colour that is shown as white."""


def add_to(commands: "Commands") -> None:
    """Declare the command."""
    parser = commands.add_parser(
        "probe", help="measure which effects a scene or a trained model calls for", allow_abbrev=False
    )
    parser.set_defaults(command=probe)
    parser.add_argument(
        "subject", metavar="SCENE|DIR", help="a generated scene (its true surfaces and light), or a folder of `train`"
    )
    parser.add_argument("--preset", default="tiny", help="budget whose steps are weighed (default: tiny; DIR: its own)")
    parser.add_argument("--seed", type=int, help="(default: 0; DIR: its own)")
    parser.add_argument("--envmap", type=Path, metavar="FILE", help="relit by this light: .hdr or .exr, lat-long, Z up")
    parser.add_argument("--picture", type=Path, metavar="PNG", help="where effects matter (default: probe-NAME.png)")
    parser.add_argument("--json", action="store_true", help="the records instead of a table")
    parser.add_argument("--threads", type=positive, metavar="N", help="CPU threads (default: all cores)")
    parser.set_defaults(device="cpu")
    add_verbose(parser)


def probe(options: argparse.Namespace) -> int:
    """Measure, show the table, and draw where each effect matters."""
    from radiogs.budget import budget

    from ..experiments import effects
    from .model import chosen_device, light_of
    from .reporter import say

    device = chosen_device(options)
    folder, preset, seed = Path(options.subject), budget(options.preset), options.seed
    light = light_of(options.envmap) if options.envmap else None
    if folder.is_dir() and (folder / "trained.json").exists():
        from ..training.trained_folder import read_trained
        from .model import scene_of

        about, model = read_trained(folder, device)
        preset, name = budget(about["preset"]), folder.name
        scene = scene_of(about["scene"], about["checksum"])
        probed = effects.probed_model(model, scene, preset, about["seed"] if seed is None else seed, device, light)
    else:
        from radiogs_datasets import load_scene

        scene = load_scene(options.subject)
        name = scene.name
        probed = effects.probed_scene(scene, preset, seed or 0, light)
    if light is not None:
        name += f"-{options.envmap.stem}"
    if options.json:
        say(json.dumps(effects.record_of(probed.found, probed.bounces), allow_nan=False))
    else:
        _show(name, probed.found, probed.bounces)
    picture = options.picture or Path(f"probe-{name}.png")
    _draw(probed.subject, picture, probed.effects)
    if not options.json:
        say(f"wrote {picture}: changes of {MATTERS:g} of the display's range and above are white")
    return 0


def _show(name: str, found: "Findings", bounces: int | None) -> None:
    from rich.table import Table

    from ..experiments.effects import psnr_of
    from .reporter import say, show

    table = Table(
        "effect", "verdict", "leaving it out costs, dB", "worst case", "rays a step", "of a step", "why",
        title=f"{name}: {found.tolerance.decibel:g} dB are tolerated beside an error of {psnr_of(found):.1f} dB",
    )  # fmt: skip
    for record in found.evidence:
        each = record.measured
        figures = ["", "", "", ""]
        if each is not None:
            figures = [
                f"{each.contribution:.3f} ({each.lowest:.3f} to {each.bound:.3f})",
                f"{each.worst:.2f}",
                f"{each.rays}",
                f"{100 * each.share:.0f} %",
            ]
        table.add_row(record.effect, record.verdict, *figures, record.why)
    show(table)
    if bounces is not None:
        say(f"bounces of light that are needed: {bounces}")


def _draw(subject: "Subject", path: Path, effects: "Sequence[str]") -> None:
    """The first sight, and beside it the change that leaving out each effect makes, one panel each."""
    import numpy as np
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    from radiogs.effects.decide.difference_maps import difference_maps

    full, maps = difference_maps(subject, effects)
    taken = subject.sights[0].target
    figure = Figure(figsize=(1.6 * (len(maps) + 1), 1.9), dpi=150, layout="constrained")
    panels = figure.subplots(1, len(maps) + 1)
    panels[0].imshow(np.clip((full if taken is None else taken).numpy(), 0, 1))
    panels[0].set_title("relit" if taken is None else "picture", fontsize=7)
    for panel, (name, change) in zip(panels[1:], maps.items(), strict=True):
        panel.imshow(change.numpy(), cmap=colormaps["inferno"], vmin=0, vmax=MATTERS)
        panel.set_title(name, fontsize=7)
    for panel in panels:
        panel.set_axis_off()
    figure.savefig(path)
