"""RadioGS: radiometrically consistent Gaussian surfels for inverse rendering (ICLR 2026).

The package has the method alone: variant and budget, radiometric consistency, the three stages, relighting, and the
choice of effects. ``radiogs_core`` has surfels, kernels, light transport, losses, and the conventions.
"""
