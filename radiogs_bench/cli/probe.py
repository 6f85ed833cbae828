"""``radiogs-bench probe``: what a scene, or a trained model, calls for, with evidence."""

import argparse
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING

from radiogs_core.errors import UsageError

from .options import add_verbose, positive

if TYPE_CHECKING:
    import torch

    from radiogs_core.contract import Probe
    from radiogs_core.scene.light import EnvironmentMap

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
    parser.add_argument("--method", default="radiogs", help="whose needs (default: radiogs; DIR: its own)")
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
    from .model import chosen_device, light_of
    from .reporter import say

    device = chosen_device(options)
    light = light_of(options.envmap) if options.envmap else None
    name, found = _probed(options, device, light)
    if light is not None:
        name += f"-{options.envmap.stem}"
    if options.json:
        say(json.dumps(found.plain(), allow_nan=False))
    else:
        _show(name, found)
    picture = options.picture or Path(f"probe-{name}.png")
    _draw(found, picture)
    if not options.json:
        say(f"wrote {picture}: changes of {MATTERS:g} of the display's range and above are white")
    return 0


def _probed(options: argparse.Namespace, device: "torch.device", light: "EnvironmentMap | None") -> "tuple[str, Probe]":
    """What it is called, and what a probe of it has found. Raises UsageError for a method that has no probes."""
    from dataclasses import replace

    from radiogs_core.contract import Probing, Run
    from radiogs_datasets import load_scene

    from ..methods import budget_of, method
    from ..training.trained_folder import read_about, read_trained

    folder = Path(options.subject)
    if folder.is_dir() and (folder / "trained.json").exists():
        using, name = method(read_about(folder)["method"]), folder.name
        run, trained = read_trained(folder, device)
        run = run if options.seed is None else replace(run, seed=options.seed)
    else:
        using, scene, trained = method(options.method), load_scene(options.subject), None
        name, budget = scene.name, budget_of(using, options.preset)
        run = Run(scene, using.variant(), budget, options.seed or 0, device)
    if not isinstance(using, Probing):
        raise UsageError(
            f"method '{using.name}' has no probes", "It simulates all that it has, whatever the scene.",
            "Probe the scene with RadioGS:  --method radiogs",
        )  # fmt: skip
    return name, using.probe(run, trained, light)


def _show(name: str, found: "Probe") -> None:
    from rich.table import Table

    from .reporter import say, show

    table = Table(
        "effect", "verdict", "leaving it out costs, dB", "worst case", "rays a step", "of a step", "why",
        title=f"{name}: {found.tolerance:g} dB are tolerated beside an error of {found.psnr:.1f} dB",
    )  # fmt: skip
    for record in found.records:
        measured = ["", "", "", ""]
        if record.measured is not None:
            # What is not finite has no value.
            each = {name: math.inf if value is None else value for name, value in record.measured.items()}
            measured = [
                f"{each['contribution']:.3f} ({each['lowest']:.3f} to {each['bound']:.3f})",
                f"{each['worst']:.2f}",
                f"{each['rays']}",
                f"{100 * each['share']:.0f} %",
            ]
        table.add_row(record.effect, record.verdict, *measured, record.why)
    show(table)
    if found.bounces is not None:
        say(f"bounces of light that are needed: {found.bounces}")


def _draw(found: "Probe", path: Path) -> None:
    """One view, and beside it the change that leaving out each effect makes, one panel each."""
    import numpy as np
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    count = 1 + len(found.differences)
    figure = Figure(figsize=(1.6 * count, 1.9), dpi=150, layout="constrained")
    panels = figure.subplots(1, count)
    panels[0].imshow(np.clip(found.reference.numpy(), 0, 1))
    panels[0].set_title("picture" if found.pictured else "relit", fontsize=7)
    for panel, (name, change) in zip(panels[1:], found.differences.items(), strict=True):
        panel.imshow(change.numpy(), cmap=colormaps["inferno"], vmin=0, vmax=MATTERS)
        panel.set_title(name, fontsize=7)
    for panel in panels:
        panel.set_axis_off()
    figure.savefig(path)
