"""Hard cases as curves: float32 against float64 on the rounded inputs (docs/stability.md)."""

from .experiment import run_stability

__all__ = ["run_stability"]
