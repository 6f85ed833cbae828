"""Records as CSV, and the fields that several of these files share."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from ..statistics import Estimate
from ..summary import Interval


def csv_of(records: Sequence[dict[str, Any]]) -> str:
    """A header and one line per record, numbers with all of their digits.

    pandas prints numbers as numpy is set to, and colour-science sets it to 12 digits where it is imported.
    """
    with np.printoptions(legacy=False):
        return pd.DataFrame.from_records(records).to_csv(index=False)


def difference_fields(interval: Interval | None) -> dict[str, float | str | None]:
    """Fields of a paired difference: its mean, the ends of its interval, the units, and whether it is resolved; None
    without one."""
    names = {"mean": "difference", "low": "difference_low", "high": "difference_high", "over": "over", "units": "units",
             "p_value": "p_value", "verdict": "resolved"}  # fmt: skip
    return {field: None if interval is None else interval[name] for name, field in names.items()}  # type: ignore[literal-required]


def estimate_fields(name: str, estimate: Estimate | None) -> dict[str, float | None]:
    """An estimate under its name and the ends of its interval under ``name_low`` and ``name_high``."""
    if estimate is None:
        return {name: None, f"{name}_low": None, f"{name}_high": None}
    return {name: estimate.mean, f"{name}_low": estimate.low, f"{name}_high": estimate.high}
