"""Published figures as data: one TOML file a table, and the only place where they stand."""

import tomllib
from dataclasses import dataclass
from difflib import get_close_matches
from importlib import resources
from typing import Literal

from radiogs.errors import UsageError


@dataclass(frozen=True)
class Column:
    """Unit of a published column, and whether larger ("up") or smaller ("down") is better."""

    unit: str
    direction: Literal["up", "down"]


@dataclass(frozen=True)
class PublishedTable:
    """A table of the paper: ``figures[row][column]``; ``label`` is its LaTeX label, ``data`` what it averages over."""

    title: str
    label: str
    data: str
    columns: dict[str, Column]
    figures: dict[str, dict[str, float]]


def published_tables() -> tuple[str, ...]:
    """Keys of the tables that are stored."""
    folder = resources.files(__package__)
    return tuple(sorted(file.name.removesuffix(".toml") for file in folder.iterdir() if file.name.endswith(".toml")))


def published(table: str) -> PublishedTable:
    """The published table of that key. Raises UsageError for an unknown one."""
    if table not in published_tables():
        near = get_close_matches(table, published_tables(), 1)
        raise UsageError(
            f"no published table '{table}'",
            f"Did you mean '{near[0]}'?" if near else "",
            f"Tables: {', '.join(published_tables())}.",
        )
    content = tomllib.loads(resources.files(__package__).joinpath(f"{table}.toml").read_text(encoding="utf-8"))
    return PublishedTable(
        title=content["title"],
        label=content["label"],
        data=content["data"],
        columns={name: Column(**column) for name, column in content["columns"].items()},
        figures=content["rows"],
    )
