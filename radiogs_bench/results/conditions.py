"""Under which conditions results were made, where they are not those of a published table."""

from collections.abc import Sequence

from radiogs_baselines.published import PublishedTable
from radiogs_core.contract import scaled
from radiogs_core.plain_values import to_plain

from ..methods import budget_of, method
from ..store.schema import Result
from ..suites.suite import Row, with_numbers

PAPER = "paper"
"""The preset with the paper's absolute numbers."""

KNOBS = {"consistency_surfels": "N_g", "incident_samples": "N_s"}
"""Numbers of the budget that labels name, with the paper's symbols."""

COSTS = ("ms", "megabytes", "hours")
"""Measures that depend on the device."""


def ran(results: Sequence[Result], table: PublishedTable, row: Row) -> str:
    """What ran for a row, as its label; empty where scenes, image size and budget are those of the published row.

    In a table of times or memory, a CPU is another condition, too.
    """
    if not results or all_as_published(results, table, row):
        return ""
    text = with_numbers(row.text, results[0]["cell"]["budget"])
    return f"{text}: {'; '.join([budgets(results), scenes(results), sizes(results), devices(results)])}"


def all_as_published(results: Sequence[Result], table: PublishedTable, row: Row) -> bool:
    """Whether the results are of all scenes of the table, at its image size, with the paper's numbers for this row."""
    conditions = table.conditions
    if {result["scene"] for result in results} != set(conditions.scenes):
        return False
    timed = any(measure in column.split("/") for column in table.columns for measure in COSTS)
    if timed and any(result["cell"]["device"] == "cpu" for result in results):
        return False
    least, most = conditions.width
    return all(
        result.get("data") is not None
        and result["data"]["layout"] == conditions.layout
        and least <= result["data"]["width"] <= most
        and result["cell"]["budget"] == to_plain(scaled(budget_of(method(result["cell"]["method"]), PAPER), row.budget))
        for result in results
    )


def budgets(results: Sequence[Result]) -> str:
    """The preset, and the numbers of it that the paper has symbols for."""
    budget = results[0]["cell"]["budget"]
    preset = budget["name"].partition(",")[0]  # behind it, what a row scales
    knobs = [f"{symbol} {budget[name]:,}" for name, symbol in KNOBS.items() if name in budget]
    return ", ".join([f"preset {preset}", *knobs])


def scenes(results: Sequence[Result]) -> str:
    """The scene, or how many there are."""
    names = list(dict.fromkeys(result["scene"] for result in results))
    return names[0] if len(names) == 1 else f"{len(names)} scenes"


def sizes(results: Sequence[Result]) -> str:
    """The images' size, or the smallest and the largest."""
    found = sorted({(result["data"]["width"], result["data"]["height"]) for result in results if "data" in result})
    if not found:
        return "image size not stored"
    texts = [f"{width} x {height}" for width, height in found]
    return texts[0] if len(texts) == 1 else f"{texts[0]} to {texts[-1]}"


def devices(results: Sequence[Result]) -> str:
    """CPU or GPU."""
    return ", ".join(sorted({"CPU" if result["cell"]["device"] == "cpu" else "GPU" for result in results}))
