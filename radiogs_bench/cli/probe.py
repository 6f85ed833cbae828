"""``radiogs-bench probe``: which light-transport effects a scene or a trained model needs, with evidence."""

import argparse
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING

from .lights import add_light_options, placed
from .options import METHOD, add_scene_options, add_verbose, declare, positive, scene_options
from .trusting import add_trust

if TYPE_CHECKING:
    from collections.abc import Mapping

    import torch

    from radiogs_core.capabilities import Probe, Probing
    from radiogs_core.scene.light import EnvironmentMap

    from .options import Commands

TRAINED = 38
"""PSNR, dB, beside which effects of a scene are judged unless ``--psnr`` says otherwise: the mean of new views of
RadioGS as recommended, preset ``tiny``, over eight scenes (docs/records/ablations.md)."""

MATTERS = 0.1
"""Changes of a pixel's display colour from this on are drawn white."""


def add_to(commands: "Commands") -> None:
    """Declare the command."""
    parser = declare(
        commands, "probe", "Measure which light-transport effects a scene or a trained model needs.",
        "probe corner --preset tiny",
    )  # fmt: skip
    parser.set_defaults(command=probe)
    parser.add_argument(
        "subject", metavar="SCENE|DIR",
        help="Probe a generated scene, with its true surfaces and light, or the model that `train` left in DIR.",
    )  # fmt: skip
    parser.add_argument(
        "--preset", default="tiny", help="Weigh rays by the steps of this preset (default: tiny; for DIR its own)."
    )
    parser.add_argument("--method", default=METHOD, help=f"Probe a scene for this method (default: {METHOD}).")
    add_trust(parser)
    parser.add_argument("--seed", type=int, help="Seed the samples with this (default: 0; for DIR its own).")
    parser.add_argument(
        "--envmap", type=Path, metavar="FILE",
        help="Probe relighting by this .hdr or .exr file, which `relight` would take.",
    )  # fmt: skip
    add_light_options(parser)
    parser.add_argument(
        "--picture", type=Path, metavar="PNG", help="Draw where effects matter here (default: probe-NAME.png)."
    )
    parser.add_argument(
        "--psnr", type=positive, metavar="DB",
        help="Judge effects beside the error of a model of this PSNR"
        f" (default: {TRAINED} for a scene; the model's own for DIR).",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="Print the records instead of a table.")
    parser.add_argument(
        "--threads", type=positive, metavar="N", help="Use N CPU threads (default: as many as there are cores)."
    )
    add_scene_options(parser)
    parser.set_defaults(device="cpu")
    add_verbose(parser)


def probe(options: argparse.Namespace) -> int:
    """Probe, print the table, and draw where each effect matters."""
    from radiogs_core.errors import UsageError
    from radiogs_datasets.lights import read_light

    from ..runs.progress import working
    from .device import chosen_device
    from .reporter import say, say_whole

    if options.picture is not None and not options.picture.absolute().parent.is_dir():
        raise UsageError(
            f"there is no folder {options.picture.parent}", "The picture could not be written there.", "Make it first."
        )
    device = chosen_device(options)
    light, repairs = read_light(options.envmap) if options.envmap else (None, [])
    if not options.json:
        for repair in repairs:
            say(repair)
    with working(f"probing {options.subject}"):
        name, found = _probed(options, device, light)
    if light is not None:
        name += f"-{options.envmap.stem}"
    if options.json:
        say_whole(json.dumps(found.plain(), allow_nan=False))
    else:
        known = (Path(options.subject) / "trained.json").exists()
        _show(name, found, options.psnr or (None if known else TRAINED))
    picture = options.picture or Path(f"probe-{name}.png")
    with working("drawing where effects matter"):
        _draw(found, picture)
    if not options.json:
        say(f"wrote {picture}: changes of {MATTERS:g} of the display's range and above are white")
    return 0


def _probed(options: argparse.Namespace, device: "torch.device", light: "EnvironmentMap | None") -> "tuple[str, Probe]":
    """The name of the scene or model, and its probe."""
    from dataclasses import replace

    from radiogs_core.contract import Run
    from radiogs_core.errors import UsageError
    from radiogs_datasets.options import AS_STORED

    from ..methods import budget_of, method, variant_of

    folder = Path(options.subject)
    if folder.is_dir() and (folder / "trained.json").exists():
        if scene_options(options) != AS_STORED:
            raise UsageError(
                "options of the scene do not go with a trained model",
                "Its scene is opened as it was for training.",
                "Leave them out, or name the scene.",
            )
        from ..runs.trained_folder import read_about, read_trained

        run, model = read_trained(folder, device)
        run = run if options.seed is None else replace(run, seed=options.seed)
        stood = None if light is None else placed(options, run.scene, light)[0]
        return folder.name, _probing(read_about(folder)["method"]).probe(run, model, stood)
    from radiogs_datasets import load_scene

    scene, used = load_scene(options.subject, options=scene_options(options)), method(options.method)
    run = Run(scene, variant_of(used, {}), budget_of(used, options.preset), options.seed or 0, device)
    stood = None if light is None else placed(options, scene, light)[0]
    return scene.name, _probing(options.method).probe(run, None, stood)


def _probing(name: str) -> "Probing":
    """The method of this name. Raises UsageError if it cannot be probed."""
    from radiogs_core.capabilities import Probing
    from radiogs_core.errors import UsageError

    from ..methods import method

    used = method(name)
    if not isinstance(used, Probing):
        raise UsageError(
            f"{used.name} cannot be probed",
            "It does not say which effects a scene needs.",
            "How a method offers it: radiogs_core.capabilities.Probing",
        )
    return used


def loss_beside(decibel: float, mse: float, psnr: float) -> float:
    """A loss of ``decibel`` beside an error ``mse``, in dB beside the error of a model of that ``psnr``."""
    lost = max(0.0, 10 ** (decibel / 10) - 1) * mse
    return 10 * math.log10(1 + lost * 10 ** (psnr / 10))


def _show(name: str, found: "Probe", psnr: int | None) -> None:
    """Print the table; if a ``psnr`` is given, also what each effect is worth beside a model of it."""
    from rich.table import Table

    from .reporter import say, show

    beside = [] if psnr is None else [f"beside {psnr} dB"]
    table = Table(
        "effect", "verdict", "leaving it out costs, dB", *beside, "worst case", "rays a step", "of a step", "why",
        title=f"{name}: {found.tolerance:g} dB are tolerated beside an error of {found.psnr:.1f} dB",
    )  # fmt: skip
    for record in found.records:
        measured = [""] * (len(beside) + 4)
        if record.measured is not None:
            # A number that is not finite is stored as None.
            each = {name: math.inf if value is None else value for name, value in record.measured.items()}
            costs = [] if psnr is None else [_beside(each, found, psnr)]
            measured = [
                f"{each['contribution']:.3f} ({each['lowest']:.3f} to {each['bound']:.3f})",
                *costs,
                f"{each['worst']:.2f}",
                f"{each['rays']}",
                f"{100 * each['share']:.0f} %",
            ]
        table.add_row(record.effect, record.verdict, *measured, record.why)
    show(table)
    if psnr is not None:
        say(
            f"The verdict is beside the error of the surfels that were probed, {found.psnr:.1f} dB. Beside a better"
            f" model, of {psnr} dB (--psnr), the same loss costs more: how much at most, and whether that is tolerated."
        )
    if found.bounces is not None:
        say(f"bounces of light that are needed: {found.bounces}")


def _beside(measured: "Mapping[str, float]", found: "Probe", psnr: int) -> str:
    bound = loss_beside(measured["bound"], found.mse, psnr)
    return f"at most {bound:.2f}: {'not needed' if bound < found.tolerance / 2 else 'needed'}"


def _draw(found: "Probe", path: Path) -> None:
    """Draw one view, and beside it the change from leaving out each effect, one panel each."""
    import numpy as np
    from matplotlib import colormaps, rc_context

    from radiogs_core.own_files import fresh
    from radiogs_reports.figures.canvas import STYLE, blank

    with rc_context(STYLE):
        count = 1 + len(found.differences)
        figure = blank(1.6 * count, 1.9)
        panels = figure.subplots(1, count)
        panels[0].imshow(np.clip(found.reference.numpy(), 0, 1))
        panels[0].set_title("picture" if found.pictured else "relit", fontsize=7)
        for panel, (name, change) in zip(panels[1:], found.differences.items(), strict=True):
            panel.imshow(change.numpy(), cmap=colormaps["inferno"], vmin=0, vmax=MATTERS)
            panel.set_title(name, fontsize=7)
        for panel in panels:
            panel.set_axis_off()
        figure.savefig(fresh(path, path.parent))
