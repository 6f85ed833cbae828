"""Published figures as data: one TOML file a table, and the only place where they stand."""

import tomllib
from dataclasses import dataclass, field
from importlib import resources
from typing import Literal

from radiogs_core.errors import unknown


@dataclass(frozen=True)
class Column:
    """Unit of a published column, and whether larger ("up") or smaller ("down") is better; "none" for a setting.

    A column of one scene names it; without a scene it is the mean over the table's data.
    """

    unit: str
    direction: Literal["up", "down", "none"]
    scene: str | None = None


@dataclass(frozen=True)
class Conditions:
    """What a table's values are of: a layout's scenes, their images' width in pixels (least, most), the protocol.

    The budget is that of preset ``paper``, times the factors of a suite's row.
    """

    layout: str
    scenes: tuple[str, ...]
    width: tuple[int, int]
    protocol: str


@dataclass(frozen=True)
class PublishedTable:
    """A table of the paper: ``figures[row][column]``, and ``printed``, the same with the paper's very digits.

    ``label`` is its LaTeX label, ``source`` where it is printed, ``data`` what it averages over, in words, and
    ``conditions`` the same as values. Column keys read
    ``task/measure`` (``task/measure/scene``), ``labels`` says what the paper calls each row. A row may lack a column:
    ``absent[row][column]`` says why. ``remarks`` by row say where the paper's tables do not agree with each other.
    """

    title: str
    label: str
    source: str
    data: str
    conditions: Conditions
    columns: dict[str, Column]
    labels: dict[str, str]
    figures: dict[str, dict[str, float]]
    printed: dict[str, dict[str, str]]
    absent: dict[str, dict[str, str]] = field(default_factory=dict)
    remarks: dict[str, str] = field(default_factory=dict)


def published_tables() -> tuple[str, ...]:
    """Keys of the tables that are stored."""
    folder = resources.files(__package__)
    return tuple(sorted(file.name.removesuffix(".toml") for file in folder.iterdir() if file.name.endswith(".toml")))


def published(table: str) -> PublishedTable:
    """The published table of that key. Raises UsageError for an unknown one."""
    if table not in published_tables():
        raise unknown("published table", table, published_tables())
    text = resources.files(__package__).joinpath(f"{table}.toml").read_text(encoding="utf-8")
    content = tomllib.loads(text, parse_float=str)
    given = content.pop("conditions")
    conditions = Conditions(
        given["layout"], tuple(given["scenes"]), (given["width"][0], given["width"][1]), given["protocol"]
    )
    columns = {name: Column(**column) for name, column in content.pop("columns").items()}
    rows = content.pop("rows").items()
    printed = {row: {name: str(figure) for name, figure in found.items()} for row, found in rows}
    figures = {row: {name: float(figure) for name, figure in found.items()} for row, found in printed.items()}
    return PublishedTable(conditions=conditions, columns=columns, figures=figures, printed=printed, **content)
