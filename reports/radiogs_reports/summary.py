"""The stored summary of a run, OUT/summary.json, key by key: every report is made from it.

The harness writes it from the store, the reports read it. ``SCHEMA`` rises when a key changes its meaning.
"""

import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, NotRequired, TypedDict, cast

from .files import opened
from .statistics import Level, Origin

SCHEMA = "radiogs-bench/summary/6"

PLAIN = re.compile(r"(?!\.)[\w.-]{1,120}")
"""Names of suites and tables, which become names of files."""

ARRAYS = re.compile(r"cells/(?!\.)[\w.-]{1,120}\.npz")

Verdict = Literal["better", "worse"]

LIMIT = "not_represented"
"""The name in a scene's ``metadata.json`` of a material that the BRDF cannot represent, such as "a clear coat"."""

EVALUATION = "evaluate"
"""The stage that scores a trained model; all other stages train it."""


class Interval(TypedDict):
    """A paired difference to the reference row: its mean, and the ends of its 95 % interval (None for one unit)."""

    mean: float
    low: float | None
    high: float | None
    over: Level
    """The units of the interval: kinds of scenes, scenes, or the seeds of a single scene."""
    units: int
    p_value: float | None
    """Two-sided p value of no difference, by Holm's correction over the rows of the column; None for one unit."""
    verdict: Verdict | None
    """Which row is resolved to be better; None if the difference is not resolved."""
    smallest: float | None
    """``analysis.power.smallest_of`` this row; None for one unit."""
    spread: dict[Level, float]
    """Standard deviations of the difference between seeds, between scenes and between kinds, where known."""


class CellSummary(TypedDict):
    """One value of the table, or None and the reason: the mean over kinds of means over scenes of means over seeds."""

    mean: float | None
    count: int
    """Number of scenes and seeds in the mean."""
    difference: Interval | None
    """Difference to the reference row; None in the reference row itself, and if the two share no scene and seed."""
    reason: str | None
    rank: NotRequired[int | None]
    """``analysis.comparisons.ranks`` among the rows of the table; None or absent for a row without one."""


class ColumnSummary(TypedDict):
    """A column of the table."""

    key: str
    """Task and measure, such as ``nvs/psnr``."""
    label: str
    unit: str
    direction: Literal["up", "down", "zero", "none"]
    """Which values are better."""
    decimals: int
    """Printed decimals."""
    meaning: NotRequired[str]
    """Definition of the metric, in words."""
    published_by: NotRequired[str]
    """The protocol of its published values, if it computes this metric by other conventions than the run's."""
    smallest: NotRequired[float | None]
    """``analysis.power.smallest_difference`` to the reference row; None if no difference has an interval."""


class RowSummary(TypedDict):
    """A row of the table."""

    key: str
    latex: str
    """Label in LaTeX; if it is empty, reports escape ``text``."""
    text: str
    """Label in plain text."""
    seconds: float | None
    """Mean training seconds per cell; None without training."""
    given: NotRequired[list[str]]
    """In a ladder of oracles: the parts of the truth that the row was given, possibly none."""
    method: NotRequired[str]
    """The title of the method that they were given to."""


class Settled(TypedDict):
    """Time until a metric stays near its final value (``analysis.settling``)."""

    seconds: float
    """Mean seconds of training."""
    low: float | None
    """Lower end of the 95 % interval; None for one unit, like ``high``."""
    high: float | None
    count: int
    """Number of scenes and seeds."""


class Doubt(TypedDict):
    """A reason why values are uncertain."""

    column: str
    """Key of the column; empty if the text marks no value: the protocol removes the quantity from all columns, or the
    text is on a method's difference from the published one or on the least error of a light map."""
    rows: list[str]
    """Keys of the rows that it concerns."""
    text: str


class SheetSummary(TypedDict):
    """One view of the contact sheet: the table row it belongs to, and the file of its maps, relative to OUT.

    Arrays are float, [height, width, channels], under ``render/<map>`` and ``truth/<map>`` for the maps image, albedo,
    normal (world, -1 to 1), roughness, indirect (linear) and relit; all are composited on black.
    """

    row: str
    scene: str
    view: str
    arrays: str
    light: NotRequired[str]


class StageSummary(TypedDict):
    """A training stage: the name that seconds, work and losses are listed under, and its title in texts and plots."""

    name: str
    title: str


class TrailPoint(TypedDict):
    """Progress of a stage after a number of steps and seconds."""

    iteration: int
    seconds: float
    losses: dict[str, float]
    """Weighted losses by name, averaged over the steps since the previous point."""
    metrics: dict[str, float]
    """Values by column, over a few test views; empty where the model was not scored."""


class PlanSummary(TypedDict):
    """The light-transport effects that a cell simulated at the end of its training, and the cost of probing them."""

    plan: dict[str, Any]
    """The plan by field; a mask over surfels is stored as the share that is on."""
    bound: float | None
    """Largest predicted loss of PSNR, in dB, over all probes; None if not stored."""
    tolerance: float | None
    """Loss in dB that the probes were allowed; None without probes."""
    probing: dict[str, float] | None
    """``seconds`` and ``rays`` that probes took in the last stage; None if not stored."""


class RunSummary(TypedDict):
    """One cell of the run: its place in the table, its metric values, its cost, and its provenance.

    An entry that a method may lack (``effects``, ``surfels``, entries of ``work`` such as rays) is None or absent, and
    reports print n/a for it.
    """

    row: str
    scene: str
    seed: int
    key: str
    state: str
    """``finished``, or its progress, or why it failed. Unless finished, all keys below are empty or None."""
    metrics: dict[str, float | None]
    """Values by column; None for a value that is not finite."""
    views: NotRequired[list[str]]
    """Names of the views that were compared; absent in earlier summaries."""
    by_view: NotRequired[dict[str, list[float | None]]]
    """Values of each view by column, in the order of ``views``, six digits; columns without one are absent."""
    stages: list[StageSummary]
    """Training stages in the order in which they run."""
    seconds: dict[str, float]
    """Seconds by stage, ``evaluate`` included."""
    work: dict[str, dict[str, int]]
    """Deterministic work counters by stage."""
    guards: dict[str, dict[str, int]]
    """How often each numerical guard acted, by stage."""
    losses: dict[str, dict[str, float]]
    """Weighted losses of the last step, by stage."""
    trail: dict[str, list[TrailPoint]]
    """Losses, and metrics where the model was scored during training, by stage."""
    effects: PlanSummary | None
    """None for methods without a plan, and without training."""
    surfels: int | None
    view: str | None
    light: str | None
    arrays: str | None
    """The file of its maps, as in ``SheetSummary``; None without maps."""
    made_from: dict[str, Any]
    """Everything that the key is a hash of."""
    sessions: dict[str, list[dict[str, Any]]]
    """Date, commit, versions, machine and memory of each process that worked on it, by stage."""


class ModesSummary(TypedDict):
    """The ways in which a method shows a trained model under another light."""

    field: str
    """The field of the variant that holds the mode, by its dotted name."""
    titles: dict[str, str]
    """Title of each mode, by its name."""
    default: str
    by_steps: list[str]
    """The modes that prepare for a light by steps of optimisation, in the order of figures."""
    steps: str
    """The field of the budget with the number of these steps, by its dotted name."""


class PaperColumn(ColumnSummary):
    """A column of a table of the paper; measured values have as many decimals as the paper prints."""

    group: str
    """Heading that it shares with neighbouring columns of the same group."""


class PaperValue(CellSummary):
    """A value of a table of the paper, measured and published; the difference is to the table's reference row."""

    published: str | None
    """The published value as printed."""
    absent: str | None
    """Why nothing was published."""


class PaperTable(TypedDict):
    """A table of the paper with all of its rows and columns, measured or not."""

    key: str
    title: str
    label: str
    """The paper's LaTeX label."""
    data: str
    """The data that published values are averaged over."""
    reference: str | None
    columns: list[PaperColumn]
    rows: list[dict[str, str]]
    """``key``, ``text``; ``remark`` and ``ran`` (the measured row's label, if it is not the paper's) may be empty."""
    cells: dict[str, dict[str, PaperValue]]
    """By row, then column."""


class ErrorParts(TypedDict):
    """The squared error of a kind of images, display sRGB, in means over kept test views, scenes and seeds."""

    error: float
    variance: float
    """The part that differs between seeds: the unbiased variance of a value over the seeds of a scene."""
    scenes: int
    """Scenes with several seeds."""


class RecordedCell(CellSummary):
    """One value of a record. The verdict of its difference is the one that the run's own table showed."""

    doubted: bool
    """Whether a footnote of the run concerned the value or the reference row's."""
    by_scene: list[float | None]
    """Difference to the reference row on each scene of the record, over the seeds; None if the two share no seed. Empty
    without a difference."""


class RunTable(TypedDict):
    """The conditions of a run and the frame of its table, which summaries and records have in common."""

    suite: str
    title: str
    protocol: str
    preset: str
    scenes: list[str]
    seeds: list[int]
    reference: str | None
    """The row to which differences are taken; None if rows are not variants of one method."""
    columns: list[ColumnSummary]
    rows: list[RowSummary]
    published: dict[str, dict[str, float]]
    """Published values by row, then column; unpublished values are absent."""
    published_data: str
    """The data that published values are averaged over."""
    machine: str
    kinds: NotRequired[dict[str, str]]
    """The kind of each scene; absent where none is known, and in earlier records."""
    stated: NotRequired[dict[str, dict[str, str]]]
    """The facts "choices", "maker", "licence" and ``LIMIT`` in the metadata of each scene; absent like ``kinds``."""


class RecordedGrid(TypedDict):
    """A table of derived values, as shown."""

    title: str
    note: str
    """How to read it."""
    sentences: list[str]
    """Its findings."""
    heads: list[str]
    lines: list[list[str]]


class RecordedRun(RunTable):
    """A finished run in a record, which is committed with the project: the values of its table, to six digits."""

    recipe: str
    """The recipe of its rows; empty where they ran by their methods' defaults."""
    origin: dict[str, str]
    """Dates, commits and command by heading (``tables.caption.origin``)."""
    cells: dict[str, dict[str, RecordedCell]]
    """By row, then column."""
    analyses: NotRequired[list[RecordedGrid]]
    """Tables beside the main one: an audit of effects, a ladder of truths, the worth of steps, of pairs of rows and of
    knobs, the order of methods; absent where its rows allow none."""
    keys: NotRequired[dict[str, str]]
    """The key of every cell by its label; other sources, settings or scenes have other keys."""


class OtherValues(TypedDict):
    """The values of one cell of another run."""

    row: str
    scene: str
    seed: int
    checksum: str
    """Digest of the scene as opened."""
    metrics: dict[str, float | None]


class OtherRun(TypedDict):
    """Another run of the same rows, to be compared with a run value by value."""

    name: str
    """The name of its folder."""
    origin: dict[str, str]
    """As in ``RecordedRun``."""
    protocol: str
    """Its ``protocol_title``."""
    settings: dict[str, dict[str, Any]]
    """Method, variant and budget by row, then dotted name."""
    values: list[OtherValues]


class Summary(RunTable):
    """The whole run."""

    schema: str
    recipe: NotRequired[str]
    """The recipe of the rows; absent where they run by their methods' defaults."""
    cells: dict[str, dict[str, CellSummary]]
    """By row, then column."""
    sheet: list[SheetSummary]
    keys: list[str]
    """Keys of the results that the values come from."""
    runs: list[RunSummary]
    """Every cell, in the order in which cells are run."""
    paper: list[PaperTable]
    """Tables of the paper with at least one measured value, other suites' tables included."""
    doubts: NotRequired[list[Doubt]]
    """Why values are uncertain; absent in earlier summaries."""
    error_parts: NotRequired[dict[str, dict[str, ErrorParts]]]
    """By row, then kind of image, for runs that measure cost with several seeds."""
    settling: NotRequired[dict[str, dict[str, Settled]]]
    """Time to quality by row, then column, where models were scored during training; absent in earlier summaries."""
    relighting: NotRequired[dict[str, ModesSummary]]
    """Ways of relighting by method; absent where no method offers several, and in earlier summaries."""
    command: NotRequired[list[str]]
    """The words of the command line after the program's name; absent where there was none."""
    longer_runs: NotRequired[list[RecordedRun]]
    """Record of longer runs of the suite, to be shown beside this one; absent where the project has none."""
    beside: NotRequired[OtherRun]
    """The run that this one is compared with; absent unless one was named."""
    left_out: NotRequired[list[str]]
    """Scenes of the run that the summary leaves out, such as those with cells still to come; absent without any."""
    conventions: dict[str, Any]
    """Every convention of the metric protocol; empty before the first result."""
    seal: NotRequired[str]
    """``seal_of`` the rest; added when it is written."""


LARGEST_SUMMARY = 1 << 28
"""Largest size in bytes."""


def read_summary(out: Path) -> Summary:
    """Read OUT/summary.json, and what it names: array files of the folder, and plain names that files are named after.

    Raises ValueError for another schema, for content that does not agree with its seal, and for a name that leads out
    of the folder.
    """
    path = out / "summary.json"
    with opened(path, LARGEST_SUMMARY) as file:
        content = file.read()
    try:
        stored: Any = json.loads(content)
    except RecursionError as error:
        raise ValueError(f"{path} is nested too deep") from error
    if not isinstance(stored, dict) or not isinstance(stored.get("schema"), str):
        raise ValueError(f"{path} is no summary; rebuild it with: radiogs-bench report {out}")
    if stored["schema"] != SCHEMA:
        raise ValueError(
            f"{path} has schema {stored['schema']}, but this version reads {SCHEMA};"
            f" rebuild it with: radiogs-bench report {out}"
        )
    if stored.get("seal") != seal_of(stored):
        raise ValueError(f"{path} does not agree with its seal; rebuild it with: radiogs-bench report {out}")
    summary = cast(Summary, stored)
    for name in (summary["suite"], *(table["key"] for table in summary["paper"])):
        if PLAIN.fullmatch(name) is None:
            raise ValueError(f"{path}: {name!r} is no plain file name")
    for each in (*summary["sheet"], *summary["runs"]):
        if each["arrays"] is not None and ARRAYS.fullmatch(each["arrays"]) is None:
            raise ValueError(f"{path}: {each['arrays']!r} is not an array file of the folder")
    return summary


def seal_of(stored: Mapping[str, Any]) -> str:
    """The seal of stored content, as the harness makes it: SHA-256 of its canonical JSON without the key ``seal``."""
    content = {name: value for name, value in stored.items() if name != "seal"}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def counted_scenes(run: Mapping[str, Any]) -> list[str]:
    """The scenes that enter means: those whose materials the BRDF can represent, or all if none is.

    ``run``: a summary, a record, or the manifest of a run.
    """
    stated = run.get("stated", {})
    return [scene for scene in run["scenes"] if LIMIT not in stated.get(scene, {})] or run["scenes"]


def origin_in(run: Mapping[str, Any], scene: str, seed: int) -> Origin:
    """The origin of a cell's values in the means of a run."""
    return Origin(scene, seed, run.get("kinds", {}).get(scene, ""), LIMIT not in run.get("stated", {}).get(scene, {}))


def protocol_title(summary: Summary) -> str:
    """Name and version of the metric protocol of the values, as ``r3dg@2``."""
    return str(summary["conventions"].get("title", summary["protocol"]))


def reference_of(summary: Summary) -> str:
    """The reference row's key. Raises ValueError for a run without a reference row."""
    reference = summary["reference"]
    if reference is None:
        raise ValueError(f"suite '{summary['suite']}' has no reference row")
    return reference


def doubted_rows(summary: Summary, column: str) -> set[str]:
    """The rows whose value in a column a footnote concerns."""
    return {row for doubt in summary.get("doubts", []) if doubt["column"] == column for row in doubt["rows"]}


def is_doubted(summary: Summary, row: str, column: str) -> bool:
    """Whether a footnote concerns a value, or the reference row's value in its column."""
    return not doubted_rows(summary, column).isdisjoint({row, summary["reference"]})


def directed_columns(summary: Summary) -> list[ColumnSummary]:
    """The columns with a better side: larger or smaller values."""
    return [column for column in summary["columns"] if column["direction"] in ("up", "down")]


def row_texts(summary: Summary) -> dict[str, str]:
    """Plain-text labels by row key, in the table's order."""
    return {row["key"]: row["text"] for row in summary["rows"]}


def half_width(interval: Interval | None) -> float | None:
    """Half the length of an interval; None without one."""
    if interval is None or interval["low"] is None or interval["high"] is None:
        return None
    return (interval["high"] - interval["low"]) / 2


def last_stage(run: RunSummary) -> StageSummary | None:
    """The training stage that runs last; None for a run without training."""
    return run["stages"][-1] if run["stages"] else None


def last_trail(run: RunSummary) -> list[TrailPoint]:
    """Progress of the last training stage; empty if not stored."""
    stage = last_stage(run)
    return [] if stage is None else run["trail"].get(stage["name"], [])


def last_stage_title(summary: Summary) -> str:
    """Title of the last training stage if all runs share one, otherwise "the last stage"."""
    titles = {stage["title"] for run in summary["runs"] if (stage := last_stage(run)) is not None}
    return titles.pop() if len(titles) == 1 else "the last stage"
