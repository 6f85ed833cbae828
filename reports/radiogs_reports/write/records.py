"""Fields that records of several CSV files share."""

from ..statistics import Estimate
from ..summary import Interval


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
