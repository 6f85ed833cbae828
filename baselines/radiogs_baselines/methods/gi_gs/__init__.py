"""GI-GS: split-sum shading of every pixel, occlusion and one bounce found on the screen (docs/baselines.md)."""
