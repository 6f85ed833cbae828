"""What accuracy costs: what each knob of the budget gives and takes, computed from a run's summary alone."""

from .report import CostReport, cost_report
from .texts import cost_csv, cost_latex, cost_markdown

__all__ = ["CostReport", "cost_csv", "cost_latex", "cost_markdown", "cost_report"]
