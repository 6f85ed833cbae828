"""SVG-IR: forward shading of four vertices a surfel, from a table of short rays traced once (docs/baselines.md)."""
