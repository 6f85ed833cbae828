"""Time to quality as CSV."""

import pandas as pd

from ..summary import Summary


def settling_csv(summary: Summary) -> str:
    """One record for each row and column: mean seconds, the ends of the interval, and over how many runs."""
    records = [
        {"row": row, "column": column, **settled}
        for row, columns in summary.get("settling", {}).items()
        for column, settled in columns.items()
    ]
    return pd.DataFrame.from_records(records).to_csv(index=False)
