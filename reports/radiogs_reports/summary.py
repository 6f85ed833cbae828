"""The stored summary of a run, which every report is made from: OUT/summary.json, key by key.

The harness writes it from the store; the reports only read. ``SCHEMA`` rises when a key changes its meaning.
"""

import json
from pathlib import Path
from typing import Any, Literal, NotRequired, TypedDict

SCHEMA = "radiogs-bench/summary/3"


class Interval(TypedDict):
    """A paired difference to the reference row: mean, and the ends of its 95 % interval (None with one pair)."""

    mean: float
    low: float | None
    high: float | None


class CellSummary(TypedDict):
    """One figure of the table: mean over scenes and seeds, or None with the reason."""

    mean: float | None
    count: int
    """How many (scene, seed) pairs it is the mean of."""
    difference: Interval | None
    """Against the reference row; None in that row, and where nothing is shared."""
    reason: str | None


class ColumnSummary(TypedDict):
    """A column: ``key`` such as ``nvs/psnr``, its heading, unit, direction of better, printed decimals."""

    key: str
    label: str
    unit: str
    direction: Literal["up", "down", "zero"]
    decimals: int


class RowSummary(TypedDict):
    """A row: key, label in LaTeX, label in plain text, and the mean seconds of training a cell."""

    key: str
    latex: str
    text: str
    seconds: float | None


class SheetSummary(TypedDict):
    """One row of the contact sheet: a row of the table, and the array file (relative to OUT) with its maps.

    Arrays are float, [height, width, channels], under ``render/<map>`` and ``truth/<map>`` for the maps image,
    albedo, normal (world, -1 to 1), roughness, indirect (linear), relit; all composited on black.
    """

    row: str
    scene: str
    view: str
    arrays: str
    light: NotRequired[str]


class TrailPoint(TypedDict):
    """How far a stage had come after so many steps and seconds.

    ``losses`` are weighted, by name, each the mean over the steps since the point before; ``metrics`` by column, over a
    few test views, empty where the model was not scored.
    """

    iteration: int
    seconds: float
    losses: dict[str, float]
    metrics: dict[str, float]


class PlanSummary(TypedDict):
    """Which effects a cell simulated when its training ended, and what probes predicted and took."""

    plan: dict[str, Any]
    """By field; of masks the share of surfels that are on."""
    bound: float | None
    """dB that the plan costs at most, by the probe that says most; None where results do not hold it."""
    tolerance: float | None
    """dB that probes tolerated; None where nothing was probed."""
    probing: dict[str, float] | None
    """``seconds`` and ``rays`` of stage 2 that probes took; None in results from before it was kept."""


class RunSummary(TypedDict):
    """One cell of the run: its place in the table, its figures, what it took, and where it comes from."""

    row: str
    scene: str
    seed: int
    key: str
    state: str
    """``finished``, or how far it is, or why it failed; what follows is empty or None unless it is finished."""
    figures: dict[str, float | None]
    """By column; None where there is no finite figure."""
    seconds: dict[str, float]
    """By stage: initialise, invert, evaluate."""
    work: dict[str, dict[str, int]]
    """Deterministic work counters by stage."""
    guards: dict[str, dict[str, int]]
    """How often each guard acted, by stage."""
    losses: dict[str, dict[str, float]]
    """The last step's weighted losses by stage."""
    trail: dict[str, list[TrailPoint]]
    """How the losses fell and, where the model was scored along the way, how the figures rose; by stage."""
    effects: PlanSummary | None
    """None where nothing was trained, and in results from before plans were kept."""
    surfels: int | None
    view: str | None
    light: str | None
    arrays: str | None
    """The array file (relative to OUT), as in ``SheetSummary``; None where there is none."""
    made_from: dict[str, Any]
    """Everything that the key is the hash of."""
    sessions: dict[str, list[dict[str, Any]]]
    """Dates, commits, versions, machines and memory of the processes that made it, by stage."""


class PaperColumn(TypedDict):
    """A column of a table of the paper; ``group`` is the heading that it shares with its neighbours."""

    key: str
    group: str
    label: str
    unit: str
    direction: Literal["up", "down", "none"]
    decimals: int
    """Of measured figures: as many as the paper prints."""


class PaperFigure(TypedDict):
    """A figure of a table of the paper, measured and published."""

    mean: float | None
    count: int
    difference: Interval | None
    """Against the table's reference row, paired over (scene, seed)."""
    reason: str | None
    """Why nothing was measured."""
    published: str | None
    """As printed."""
    absent: str | None
    """Why nothing was published."""


class PaperTable(TypedDict):
    """A table of the paper, with all of its rows and columns, whichever of them the store has figures for."""

    key: str
    title: str
    label: str
    """The paper's LaTeX label."""
    data: str
    """What the published figures are the mean of."""
    reference: str | None
    columns: list[PaperColumn]
    rows: list[dict[str, str]]
    """``key``, ``text`` and ``remark`` (empty where there is none)."""
    cells: dict[str, dict[str, PaperFigure]]
    """By row, then column."""


class Summary(TypedDict):
    """The whole run."""

    schema: str
    suite: str
    title: str
    protocol: str
    preset: str
    scenes: list[str]
    seeds: list[int]
    reference: str | None
    """The row that differences are taken to; None where the rows are no variants of one thing."""
    columns: list[ColumnSummary]
    rows: list[RowSummary]
    cells: dict[str, dict[str, CellSummary]]
    """By row, then column."""
    published: dict[str, dict[str, float]]
    """Published figures by row, then column; a figure that was not published is absent."""
    published_data: str
    """What the published figures are the mean of."""
    machine: str
    sheet: list[SheetSummary]
    keys: list[str]
    """Keys of the results that the figures come from."""
    runs: list[RunSummary]
    """Every cell, in the order in which they are run."""
    paper: list[PaperTable]
    """The tables of the paper that the store holds figures for, also of other suites than this run's."""
    conventions: dict[str, Any]
    """What the metric protocol does, spelled out; empty before the first result."""


def read_summary(out: Path) -> Summary:
    """Read OUT/summary.json. Raises ValueError if it was written under another schema."""
    summary: Summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    if summary["schema"] != SCHEMA:
        raise ValueError(f"{out / 'summary.json'} has schema {summary['schema']}; this version reads {SCHEMA}")
    return summary


def reference_of(summary: Summary) -> str:
    """The row that others are compared with. Raises ValueError for a run whose rows are no variants of one thing."""
    reference = summary["reference"]
    if reference is None:
        raise ValueError(f"the rows of suite '{summary['suite']}' are not compared with one of them")
    return reference
