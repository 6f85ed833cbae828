"""R3DG: surfels shaded before blending, a table of visibility, learnt local light (docs/baselines.md)."""
