"""Published values as data, one TOML file for each table; no other file repeats them."""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib import resources
from typing import Literal

from radiogs_core.errors import unknown
from radiogs_core.plain_values import from_plain


@dataclass(frozen=True)
class Column:
    """A column of a published table."""

    unit: str
    """Unit of the values."""
    direction: Literal["up", "down", "none"]
    """Whether larger ("up") or smaller ("down") values are better; "none" for a setting."""
    scene: str | None = None
    """Scene of the values; None: their mean over the table's data."""


@dataclass(frozen=True)
class Conditions:
    """The data and protocol of a table's values; the budget is the preset ``paper`` times the factors of a row."""

    data_set: str
    """Folder of the scenes in a root of data, by which ``datasets fetch`` knows them."""
    layout: str
    """Layout of the scenes."""
    scenes: tuple[str, ...]
    """Names of the scenes."""
    width: tuple[int, int]
    """Smallest and largest width of the images, pixels."""
    protocol: str
    """Name of the metric protocol."""


@dataclass(frozen=True)
class PublishedTable:
    """A table of the paper. Column keys are ``task/measure`` or ``task/measure/scene``."""

    title: str
    """Title of the table."""
    label: str
    """LaTeX label of the table."""
    source: str
    """Where the table is printed."""
    data: str
    """The data that it averages over, in words."""
    conditions: Conditions
    """The same data as values, with the protocol."""
    columns: dict[str, Column]
    """Columns by key."""
    labels: dict[str, str]
    """The paper's name of each row."""
    figures: dict[str, dict[str, float]]
    """Values by row and column."""
    printed: dict[str, dict[str, str]]
    """The same values with the digits that the paper prints."""
    absent: dict[str, dict[str, str]] = field(default_factory=dict)
    """Reasons why a row lacks a column, by row and column."""
    remarks: dict[str, str] = field(default_factory=dict)
    """Sentences, by row, on tables of the paper that contradict each other."""
    further: str = ""
    """Key of a table that has values of the same rows in columns which this one lacks; empty for none."""


def published_tables() -> tuple[str, ...]:
    """Keys of the stored tables."""
    folder = resources.files(__package__)
    return tuple(sorted(file.name.removesuffix(".toml") for file in folder.iterdir() if file.name.endswith(".toml")))


def published(table: str) -> PublishedTable:
    """The published table of a key. Raises UsageError for an unknown key."""
    if table not in published_tables():
        raise unknown("published table", table, published_tables())
    text = resources.files(__package__).joinpath(f"{table}.toml").read_text(encoding="utf-8")
    content = tomllib.loads(text, parse_float=str)
    printed = {row: {name: str(figure) for name, figure in found.items()} for row, found in content.pop("rows").items()}
    figures = {row: {name: float(figure) for name, figure in found.items()} for row, found in printed.items()}
    found: PublishedTable = from_plain(PublishedTable, {**content, "printed": printed, "figures": figures}, table)
    return found


def values_beside(key: str | None, columns: Sequence[str]) -> tuple[dict[str, dict[str, float]], str]:
    """Published values, by row and column, to print beside a run with these columns, and their data.

    Columns that the table lacks are taken from its ``further`` table, whose data may be others. Without a ``key`` there
    are none. Raises UsageError for an unknown key.
    """
    if key is None:
        return {}, "none for this suite"
    table = published(key)
    figures, data = {row: dict(values) for row, values in table.figures.items()}, table.data
    if table.further:
        other = published(table.further)
        lacking = [column for column in columns if column in other.columns and column not in table.columns]
        for row in figures.keys() & other.figures.keys():
            figures[row] |= {column: other.figures[row][column] for column in lacking if column in other.figures[row]}
        if lacking:
            data = f"{data}; for columns that this table does not report, {other.data}"
    return figures, data
