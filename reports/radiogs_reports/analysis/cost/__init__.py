"""What accuracy costs: what each knob of the budget gives and takes, computed from a run's summary alone."""

from .report import CostReport, cost_report

__all__ = ["CostReport", "cost_report"]
