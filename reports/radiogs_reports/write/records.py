"""Fields that records of several CSV files share."""

from ..statistics import Estimate
from ..summary import Interval


def difference_fields(interval: Interval | None) -> dict[str, float | None]:
    """A paired difference and the ends of its interval; None where there is none."""
    if interval is None:
        return {"difference": None, "difference_low": None, "difference_high": None}
    return {
        "difference": interval["mean"], "difference_low": interval["low"], "difference_high": interval["high"],
    }  # fmt: skip


def estimate_fields(name: str, estimate: Estimate | None) -> dict[str, float | None]:
    """An estimate under its name and the ends of its interval under ``name_low`` and ``name_high``."""
    if estimate is None:
        return {name: None, f"{name}_low": None, f"{name}_high": None}
    return {name: estimate.mean, f"{name}_low": estimate.low, f"{name}_high": estimate.high}
