"""Values, headings and counts in plain text."""

import re
from collections.abc import Callable, Sequence

from .statistics import Level
from .summary import LIMIT, ColumnSummary, RecordedRun, Summary, counted_scenes

ARROWS = {"up": "↑", "down": "↓", "zero": "→ 0", "none": ""}
"""Arrows towards the better values of a column, by its direction."""

SYMBOL = re.compile(r"(?<![A-Za-z])([LλN])_([A-Za-z]+)(?:\^([A-Za-z]+))?")
"""Symbols in labels: L_rad, L_G^PBR, λ_rad, N_g."""


def mathematics(symbol: str, lower: str, upper: str | None) -> str:
    r"""The groups of ``SYMBOL`` as LaTeX and matplotlib set them: ``$L_\mathrm{G}^\mathrm{PBR}$``."""
    base = {"λ": r"\lambda"}.get(symbol, symbol)
    raised = "" if upper is None else rf"^\mathrm{{{upper}}}"
    return rf"${base}_\mathrm{{{lower}}}{raised}$"


SUFFIXES = (("M", 1e6), ("k", 1e3))


def heading(column: ColumnSummary) -> str:
    """Label, arrow towards better values, unit: ``NVS PSNR ↑ (dB)``."""
    unit = f" ({column['unit']})" if column["unit"] else ""
    return f"{column['label']} {ARROWS[column['direction']]}{unit}"


def label_with_unit(column: ColumnSummary) -> str:
    """``NVS PSNR, dB``."""
    return f"{column['label']}, {column['unit']}" if column["unit"] else column["label"]


ROUNDING = 1e-9
"""Values below this are zero up to rounding in floating point."""


def number(value: float, decimals: int, sign: str = "-") -> str:
    """A value with its decimals; with two significant digits if these decimals would all be 0."""
    text = f"{value:{sign}.{decimals}f}"
    if float(text):
        return text
    return f"{value:{sign}.2g}" if abs(value) > ROUNDING else f"{0:.{decimals}f}"


def signed(value: float, decimals: int) -> str:
    """A difference with its sign; without one if it rounds to zero."""
    text = f"{value:+.{decimals}f}"
    return text if float(text) else text[1:]


def shared_decimals(values: Sequence[float], decimals: int) -> int:
    """The decimals of values printed together: up to two more if one of them would be printed as zero."""
    smallest = min((abs(each) for each in values if abs(each) > ROUNDING), default=1.0)
    return next((each for each in (decimals, decimals + 1) if float(f"{smallest:.{each}f}")), decimals + 2)


def plus_minus(
    mean: float, half_width: float | None, decimals: int, text_of: Callable[[float, int], str] = signed
) -> str:
    """A mean and the half-width of its interval, if any, with enough decimals for the half-width not to be zero."""
    if half_width is None:
        return text_of(mean, decimals)
    decimals = shared_decimals([half_width], decimals)
    return f"{text_of(mean, decimals)} ± {number(half_width, decimals)}"


def count_of(count: int, noun: str) -> str:
    """A count with its noun, in the plural where it needs one: ``2 seeds``."""
    return f"{count} {noun}" + ("" if count == 1 else "s")


def population(over: Level, units: int, scene: str = "one scene") -> str:
    """The units of an interval, in words: ``over 4 scenes, each with the mean over its seeds``."""
    if over == "kinds":
        return f"over {count_of(units, 'kind')} of scenes, each with the mean over its scenes"
    if over == "scenes":
        return f"over {count_of(units, 'scene')}, each with the mean over its seeds"
    return f"over {count_of(units, 'seed')} of {scene}, and of that scene alone"


def population_of(summary: Summary) -> str:
    """The units of the intervals of a complete run, in words."""
    scenes, kinds = counted_scenes(summary), kinds_of(summary)
    if kinds > 1:
        return population("kinds", kinds)
    return population("scenes", len(scenes)) if len(scenes) > 1 else population("seeds", len(summary["seeds"]), *scenes)


def mean_over(run: Summary | RecordedRun, named: bool = True) -> str:
    """The units that the means of a complete run are over, in words: ``2 scenes (corner, bowl) and 1 seed``.

    ``named``: with the names of the scenes and their marks. Scenes that means leave out are named behind.
    """
    held, kinds = counted_scenes(run), kinds_of(run)
    scenes = count_of(len(held), "scene")
    scenes += f" ({', '.join(marked(run, each) for each in held)})" if named else ""
    if 1 < kinds < len(held):
        scenes = f"{kinds} kinds of {scenes}, each kind with the mean over its scenes,"
    left = "".join(f", without {marked(run, each)}" for each in run["scenes"] if each not in held)
    return f"{scenes} and {count_of(len(run['seeds']), 'seed')}{left}"


def marked(run: Summary | RecordedRun, scene: str) -> str:
    """A scene's name with its marks: "tuned on", "other hands", and a material that the BRDF cannot represent."""
    about = run.get("stated", {}).get(scene, {})
    marks = [text for text in (about.get("choices"), about.get("maker")) if text not in (None, "reported only")]
    marks += [f"the BRDF cannot represent {about[LIMIT]}"] if LIMIT in about else []
    return f"{scene} [{', '.join(marks)}]" if marks else scene


def kinds_of(run: Summary | RecordedRun) -> int:
    """The number of kinds of a run's scenes, 1 if unknown; records without the kinds count in intervals."""
    if "kinds" in run:
        return len({run["kinds"].get(scene, "") for scene in counted_scenes(run)})
    differences = [cell["difference"] for cells in run["cells"].values() for cell in cells.values()]
    return max((each["units"] for each in differences if each and each["over"] == "kinds"), default=1)


def short_number(value: float) -> str:
    """A number in few characters: thousands as k, millions as M."""
    for suffix, size in SUFFIXES:
        if abs(value) >= size:
            return f"{value / size:g}{suffix}"
    return f"{value:g}"
