"""SVG-IR: forward shading of four vertices a surfel, from a table of short rays kept once (docs/baselines.md)."""
