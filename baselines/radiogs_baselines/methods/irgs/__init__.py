"""IRGS: Monte-Carlo shading of every pixel, with rays traced through the surfels' own radiance (docs/baselines.md)."""
