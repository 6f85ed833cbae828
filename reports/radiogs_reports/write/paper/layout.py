"""How the paper lays a table out, where that is not a line for each row."""

from ...summary import PaperColumn, PaperFigure, PaperTable

SIDE_BY_SIDE = ("views",)
"""Tables that print a line for each setting and their methods side by side; rows are stored as method-setting."""


def as_printed(table: PaperTable) -> PaperTable:
    """The table with the lines and columns of the print; most are stored so."""
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
    cells: dict[str, dict[str, PaperFigure]] = {
        setting: {
            f"{column['key']} {method}": table["cells"][f"{method}-{setting}"][column["key"]]
            for column in table["columns"]
            for method in methods
        }
        for setting in settings
    }
    rows = [{"key": setting, "text": text, "remark": ""} for setting, text in settings.items()]
    return {**table, "columns": columns, "rows": rows, "cells": cells}
