"""The oracle ladder as CSV."""

import pandas as pd

from ..analysis.ladder import LadderReport
from .records import estimate_fields


def ladder_csv(report: LadderReport) -> str:
    """One record per method, scene, metric and part: values and gains with the ends of their intervals."""
    records = []
    for rung in report.rungs:
        for part, share in rung.parts.items():
            estimates = {
                "nothing_given": rung.nothing, "first_in": share.first_in, "last_out": share.last_out,
                "everything_given": rung.everything,
            }  # fmt: skip
            records.append(
                {"method": rung.method, "scene": rung.scene, "metric": rung.column["key"], "part": part}
                | {key: value for name, each in estimates.items() for key, value in estimate_fields(name, each).items()}
            )
    return pd.DataFrame.from_records(records).to_csv(index=False)
