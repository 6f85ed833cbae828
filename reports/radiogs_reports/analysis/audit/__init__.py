"""The audit of plans: what leaving effects out has cost, beside what was predicted, from a run's summary alone."""

from .report import AuditReport, audit_report

__all__ = ["AuditReport", "audit_report"]
