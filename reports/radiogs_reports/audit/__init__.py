"""The audit of plans: what leaving effects out has cost, beside what was predicted, from a run's summary alone."""

from .report import AuditReport, audit_report
from .texts import audit_csv, audit_latex, audit_markdown

__all__ = ["AuditReport", "audit_csv", "audit_latex", "audit_markdown", "audit_report"]
