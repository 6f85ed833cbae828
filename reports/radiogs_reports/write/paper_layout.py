"""Tables that the paper prints with its methods side by side instead of one line per row."""

from ..summary import PaperColumn, PaperTable, PaperValue

SIDE_BY_SIDE = ("views",)
"""Keys of tables with a line per setting and the methods side by side; their rows are stored as method-setting."""


def as_printed(table: PaperTable) -> PaperTable:
    """The table with the lines and columns that the paper prints; most tables are stored that way."""
    if table["key"] not in SIDE_BY_SIDE:
        return table
    methods: dict[str, str] = {}
    settings: dict[str, str] = {}
    for row in table["rows"]:
        method, _, setting = row["key"].rpartition("-")
        methods[method], _, settings[setting] = row["text"].partition(", ")
    columns: list[PaperColumn] = [
        {
            **column,
            "key": f"{column['key']} {method}",
            "group": f"{column['group']} {column['label']}",
            "label": text,
            "unit": "",
        }
        for column in table["columns"]
        for method, text in methods.items()
    ]
    cells: dict[str, dict[str, PaperValue]] = {
        setting: {
            f"{column['key']} {method}": table["cells"][f"{method}-{setting}"][column["key"]]
            for column in table["columns"]
            for method in methods
        }
        for setting in settings
    }
    ran = {row["key"].rpartition("-")[2]: row.get("ran", "") for row in reversed(table["rows"]) if row.get("ran")}
    rows = [
        {"key": setting, "text": text, "remark": "", "ran": ran.get(setting, "")} for setting, text in settings.items()
    ]
    return {**table, "columns": columns, "rows": rows, "cells": cells}
