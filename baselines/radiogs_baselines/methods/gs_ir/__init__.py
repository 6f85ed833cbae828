"""GS-IR: deferred split-sum shading under baked ambient occlusion and a learnt irradiance (docs/baselines.md)."""
