"""``radiogs-bench probe``: which light-transport effects a scene or a trained model needs, with evidence."""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from radiogs_core.errors import UsageError
from radiogs_datasets.options import AS_STORED, SceneOptions

from .lights import AS_IT_LIES, Placing, placed
from .options import METHOD, Count, Data, Json, MethodName, Opened, PresetName, SceneName, Trust
from .reporter import say, say_whole, show

if TYPE_CHECKING:
    from collections.abc import Mapping

    from radiogs_core.capabilities import Probe, Probing
    from radiogs_core.scene.light import EnvironmentMap
    from radiogs_core.scene.scene import Scene

TRAINED = 38
"""Default of ``--psnr`` for a scene, dB: the model error beside which effects are judged. Mean PSNR of new views of
RadioGS as recommended, preset ``tiny``, over eight scenes (docs/records/ablations.md)."""

MATTERS = 0.1
"""Changes of a pixel's display colour from this on are drawn white."""


@dataclass(frozen=True)
class Asked:
    """Options of a probe."""

    preset: PresetName = "tiny"
    """Weigh rays by the steps of this preset; a trained model has its own."""
    method: MethodName = METHOD
    """Probe a scene for this method."""
    trust: Trust = ()
    seed: int | None = None
    """Seed the samples with this (default: 0; for a trained model its own)."""
    envmap: Path | None = None
    """Probe relighting by this .hdr or .exr file, which `relight` would take."""
    picture: Path | None = None
    """Draw where effects matter in this .png file."""
    psnr: Count | None = None
    """Judge effects beside the error of a model of this PSNR, in dB (default: 38; a trained model's own)."""
    as_json: Json = False
    """Print the records instead of a table."""
    threads: Count | None = None
    """Use N CPU threads (default: as many as there are cores)."""


def probe(
    subject: SceneName,
    /,
    *,
    asked: Annotated[Asked, Parameter(name="*")] = Asked(),
    placing: Placing = AS_IT_LIES,
    data: Data = None,
    opened: Opened = AS_STORED,
) -> None:
    """Measure which light-transport effects a scene or a trained model needs.

    Example:  radiogs-bench probe corner --preset tiny

    :param subject: Probe a generated scene, with its true surfaces and light, or the model that `train` left in a
        folder.
    """
    from radiogs_datasets.lights import read_light

    from ..runs.progress import working

    picture, envmap = asked.picture, asked.envmap
    if picture is not None and not picture.absolute().parent.is_dir():
        raise UsageError(
            f"there is no folder {picture.parent}", "The picture could not be written there.", "Make it first."
        )
    light, repairs = read_light(envmap) if envmap else (None, [])
    if not asked.as_json:
        say(*repairs)
    with working(f"probing {subject}"):
        name, found = _probed(
            subject, asked, opened, lambda scene: None if light is None else placed(placing, scene, light)[0]
        )
    if envmap is not None:
        name += f"-{envmap.stem}"
    if asked.as_json:
        say_whole(json.dumps(found.plain(), allow_nan=False))
    else:
        known = (Path(subject) / "trained.json").exists()
        _show(name, found, asked.psnr or (None if known else TRAINED))
    if picture is None:
        return
    with working("drawing where effects matter"):
        _draw(found, picture)
    if not asked.as_json:
        say(f"wrote {picture}: changes of {MATTERS:g} of the display's range and above are white")


def _probed(
    subject: str, asked: Asked, opened: SceneOptions, lit: "Callable[[Scene], EnvironmentMap | None]"
) -> "tuple[str, Probe]":
    """Probe a scene or model; returns its name and its probe. ``lit``: the light that relights a scene, or None."""
    from radiogs_core.contract import Run
    from radiogs_datasets import load_scene

    from ..device import use
    from ..methods import budget_of, method, variant_of
    from ..runs.trained_folder import read_about, read_trained

    folder, device = Path(subject), use("cpu", asked.threads)
    if not (folder / "trained.json").exists():
        scene, used = load_scene(subject, options=opened), method(asked.method)
        run = Run(scene, variant_of(used, {}), budget_of(used, asked.preset), asked.seed or 0, device)
        return scene.name, _probing(asked.method).probe(run, None, lit(scene))
    if opened != AS_STORED:
        raise UsageError(
            "options of the scene do not go with a trained model",
            "Its scene is opened as it was for training.",
            "Leave them out, or name the scene.",
        )
    run, model = read_trained(folder, device)
    run = run if asked.seed is None else replace(run, seed=asked.seed)
    return folder.name, _probing(read_about(folder)["method"]).probe(run, model, lit(run.scene))


def _probing(name: str) -> "Probing":
    """The method of this name. Raises UsageError if it cannot be probed."""
    from radiogs_core.capabilities import Probing

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
    """A loss of ``decibel`` beside the error ``mse``, converted to dB beside the error of a model of that ``psnr``."""
    lost = max(0.0, 10 ** (decibel / 10) - 1) * mse
    return 10 * math.log10(1 + lost * 10 ** (psnr / 10))


def _show(name: str, found: "Probe", psnr: int | None) -> None:
    """Print the table; given a ``psnr``, also each effect's loss beside a model of that PSNR."""
    from rich.table import Table

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
