"""Hard cases as curves: float32 against float64 on the rounded inputs (docs/stability.md)."""
