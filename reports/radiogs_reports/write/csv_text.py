"""Records as CSV, and the fields of a value in them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from ..summary import CellSummary, ColumnSummary, PaperColumn, PaperValue, Summary
from ..wording import mean_over


def csv_of(records: Sequence[dict[str, Any]]) -> str:
    """A header and one line per record, numbers with all of their digits.

    pandas prints numbers as numpy is set to, and colour-science sets it to 12 digits where it is imported.
    """
    with np.printoptions(legacy=False):
        return pd.DataFrame.from_records(records).to_csv(index=False)


def value_fields(
    summary: Summary, column: ColumnSummary | PaperColumn, value: CellSummary | PaperValue, published: Any
) -> dict[str, Any]:
    """The fields of a value of a table: its mean and the mean's units, its difference to the reference row with the
    ends of its interval, units and whether it is resolved, its rank, and the published value beside it."""
    interval = value["difference"]
    names = {"mean": "difference", "low": "difference_low", "high": "difference_high", "over": "over", "units": "units",
             "p_value": "p_value", "verdict": "resolved"}  # fmt: skip
    return {
        "column": column["key"],
        "unit": column["unit"],
        "direction": column["direction"],
        "mean": value["mean"],
        "count": value["count"],
        "mean_over": mean_over(summary),
        **{field: None if interval is None else interval[name] for name, field in names.items()},  # type: ignore[literal-required]
        "rank": value.get("rank"),
        "smallest_resolved": column.get("smallest"),
        "published": published,
        "published_by": column.get("published_by"),
    }
