"""The audit as CSV."""

import pandas as pd

from ..analysis.audit import AuditReport
from .records import estimate_fields


def audit_csv(report: AuditReport) -> str:
    """One record per scene and row: estimates with the ends of their intervals, shares between 0 and 1."""
    records = []
    for line in report.lines:
        estimates = {f"{name}_loss": loss for name, loss in line.losses.items()} | {
            "rays_saved": line.rays_saved, "last_stage_times_as_fast": line.last_stage,
            "training_times_as_fast": line.training, "probes_of_last_stage": line.probes_of_last_stage,
            "probes_of_training": line.probes_of_training, "probe_rays_share": line.probe_rays,
        }  # fmt: skip
        records.append(
            {"scene": line.scene, "row": line.row, "seeds": line.seeds, "bound": line.bound,
             "tolerance": line.tolerance, "under_bound": line.judgement, "left_out": line.left_out}
            | {key: value for name, each in estimates.items() for key, value in estimate_fields(name, each).items()}
        )  # fmt: skip
    return pd.DataFrame.from_records(records).to_csv(index=False)
