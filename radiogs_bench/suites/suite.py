"""Suites: the types of rows and columns, and the tasks of columns."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from radiogs_core.capabilities import Part
from radiogs_core.contract import current_name
from radiogs_core.errors import UsageError
from radiogs_core.plain_values import flat, to_plain

from ..methods import DEFAULT
from ..scoring.metrics.measures import MEASURES, Measure
from .experiment import TRAINING


@dataclass(frozen=True)
class Task:
    """The subject of a metric."""

    label: str
    """First words of a column's heading."""
    meaning: str
    """Definition, in words that continue ``Measure.meaning``."""
    counted: bool = False
    """Whether its metrics are neutral counts, by which rows are not ranked."""


TASKS: Mapping[str, Task] = {
    "nvs": Task("NVS", "of test views under the training light"),
    "normal": Task("Normal", "of the normal maps of test views"),
    "albedo": Task("Albedo", "of the albedo maps of test views"),
    "roughness": Task("Roughness", "of the roughness maps of test views"),
    "relight": Task("Relight", "of test views under lights that training did not show"),
    "indirect": Task("Indirect", "of the light that reaches pixels by way of other surfaces"),
    "render": Task("Rendering", "of rendering a frame"),
    "prepare": Task("Preparing a light", "of adapting a model to a new light"),
    "total": Task("Total", "of the whole image"),
    "surfels": Task("Surfels' own", "of the surfels' own radiance"),
    "direct": Task("Direct", "of the light that arrives without a bounce"),
    "depth": Task("Depth", "of the depth maps of test views"),
    "environment": Task("Light", "of the recovered environment map"),
    "shape": Task("Shape", "of the extracted surface"),
    "forward": Task("Forward", "of values"),
    "gradient": Task("Gradient", "of gradients"),
    "guards": Task("Guards", "of the numerical guards", counted=True),
    "training": Task("Training", "of training"),
    "stage2": Task("Stage 2", "of a step of stage 2"),
    "plan": Task("Plan", "of the plan of effects"),
    "scale": Task("Albedo", "that recovered albedo needs", counted=True),
}


COLUMNS: Mapping[str, Measure] = {
    **MEASURES,
    "factor": Measure("factor", "", "up", 2, "geometric mean over channels of the factor"),
}
"""Measures of columns by name: computed ones, and the factor found by the alignment of albedo."""


@dataclass(frozen=True)
class Metric:
    """A column of a table: what is compared (``task``) and how (``measure``)."""

    task: str
    measure: str

    @property
    def key(self) -> str:
        """Its name in results, such as ``nvs/psnr``."""
        return f"{self.task}/{self.measure}"

    @property
    def label(self) -> str:
        """The heading, such as ``NVS PSNR``."""
        return f"{TASKS[self.task].label} {COLUMNS[self.measure].label}"

    @property
    def meaning(self) -> str:
        """Definition, such as ``peak signal-to-noise ratio of test views under the training light``."""
        return f"{COLUMNS[self.measure].meaning} {TASKS[self.task].meaning}"

    @classmethod
    def of(cls, key: str) -> "Metric":
        """The inverse of ``key``."""
        task, _, measure = key.partition("/")
        return cls(task, measure)


def metrics(*keys: str) -> tuple[Metric, ...]:
    """Columns by their keys, each with one measure or several: ``nvs/psnr,ssim``."""
    pairs = (key.split("/") for key in keys)
    return tuple(Metric(task, measure) for task, measures in pairs for measure in measures.split(","))


@dataclass(frozen=True)
class Row:
    """A row of a table.

    Its labels may contain names of budget numbers, such as ``<incident_samples>``, which a run replaces by the preset's
    numbers (``with_numbers``).
    """

    key: str
    """Key of the row, unique in its suite."""
    latex: str
    """Label in LaTeX; if it is empty, reports escape ``text``."""
    text: str
    """Label in plain text."""
    variant: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the variant that differ from the full method, as plain values."""
    budget: Mapping[str, float] = field(default_factory=dict)
    """Factors for fields of the preset, so that a row is the same share of the work in each preset."""
    settings: Mapping[str, float] = field(default_factory=dict)
    """Settings of the experiment, if it has any."""
    method: str = DEFAULT
    """Name of the method."""
    recipe: str = ""
    """Name of the recipe of the method that ``variant`` changes (``radiogs_core.capabilities.OffersRecipes``); empty:
    the suite's recipe."""
    given: tuple[Part, ...] | None = None
    """Parts of the truth that the method is given (``radiogs_core.capabilities.TakesGiven``): empty for the row of a
    ladder that is given nothing, None for a row outside a ladder."""
    numbers: Mapping[str, Any] = field(default_factory=dict)
    """Values that replace the preset's numbers, by dotted names; the factors multiply them."""


JUDGED = ("front_patterned", "lamps", "still_life", "orators")
"""Scenes of four kinds on which no setting was chosen; two are by other hands."""


@dataclass(frozen=True)
class Suite:
    """A table: rows by columns over scenes and seeds."""

    name: str
    """Name of the suite."""
    title: str
    """Title of the table."""
    published: str | None
    """Published table that is shown beside it; None for none."""
    reference: str | None
    """Row against which differences and their intervals are paired; None if rows are not variants of one method."""
    rows: tuple[Row, ...]
    """Rows of the table."""
    columns: tuple[Metric, ...]
    """Columns of the table."""
    scenes: tuple[str, ...] = field(default=("corner",))
    """Scenes that ``run`` uses by default."""
    experiment: str = TRAINING
    """Experiment of every cell (see ``experiment``)."""
    protocol: str = "default"
    """Metric protocol that ``run`` uses by default."""
    download: str = ""
    """Where to find scenes that do not come with the package."""
    data_set: str = ""
    """Folder of these scenes below the root of data."""
    recipe: str = ""
    """Recipe of the rows that name none, if their methods offer any; empty: the methods' defaults. ``run --recipe``
    takes its place."""

    def __post_init__(self) -> None:
        keys = [row.key for row in self.rows]
        repeated = sorted({key for key in keys if keys.count(key) > 1})
        if repeated:
            raise UsageError(f"suite '{self.name}' has rows of the same key: {', '.join(repeated)}")
        if self.reference is not None and self.reference not in keys:
            raise UsageError(
                f"suite '{self.name}' has no row '{self.reference}' to compare with", f"Its rows: {', '.join(keys)}."
            )


PAPER_BUDGET: Mapping[str, int] = {"consistency_surfels": 4096, "incident_samples": 64}
"""N_g and N_s of preset ``paper``."""


def knob_rows(
    key: str, symbol: str, name: str, values: Sequence[int], held: Mapping[str, int] | None = None
) -> tuple[Row, ...]:
    """Rows that set the budget's field ``name`` to the paper's ``values`` under preset ``paper``.

    ``held``: the paper's values of fields that are the same in all rows. Under any other preset a row is the same share
    of the preset's value; its label shows the resulting value.

    >>> [(row.key, row.budget) for row in knob_rows("ns", "N_s", "incident_samples", (16, 64))]
    [('ns-16', {'incident_samples': 0.25}), ('ns-64', {'incident_samples': 1.0})]
    """
    return tuple(
        Row(
            f"{key}-{paper}", f"${symbol}=<{name}>$", f"{symbol} = <{name}> (paper: {paper})",
            {}, {each: count / PAPER_BUDGET[each] for each, count in {**(held or {}), name: paper}.items()},
        )
        for paper in values
    )  # fmt: skip


NUMBER = re.compile(r"<([a-z_][\w.]*(?:\+[a-z_][\w.]*)*)>")
"""A number of the budget in a label, or a sum of some, by dotted names: ``<incident_samples>``."""


def with_numbers(label: str, budget: Any) -> str:
    """A row's label, with dotted names replaced by the numbers of its budget (or the budget's plain values).

    A former name works as in a row's factors (``contract.current_name``). Raises UsageError for a name that is not a
    field of the budget.

    >>> with_numbers("N = <first+second> of <first>", {"first": 2, "second": 1})
    'N = 3 of 2'
    """

    numbers = flat(budget if isinstance(budget, Mapping) else to_plain(budget))

    def number(found: re.Match[str]) -> str:
        names = [current_name(budget, name) for name in found[1].split("+")]
        for name in names:
            if name not in numbers:
                raise UsageError(
                    f"the label '{label}' names '{name}', which the budget does not have",
                    f"It has: {', '.join(numbers)}.",
                    "Labels name numbers of the budget as <name>.",
                )
        return f"{sum(numbers[name] for name in names)}"

    return NUMBER.sub(number, label)
