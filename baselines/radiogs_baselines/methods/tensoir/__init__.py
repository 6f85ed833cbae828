"""TensoIR: a vector-matrix factorised radiance field whose rays are marched, not surfels (docs/baselines.md)."""
