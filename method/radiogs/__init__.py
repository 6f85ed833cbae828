"""RadioGS: radiometrically consistent Gaussian surfels for inverse rendering (ICLR 2026).

The method alone: its variant and budget, radiometric consistency, its three stages, relighting, and the choice of
effects. Surfels, kernels, light transport and losses are those of ``radiogs_core``, and so are the conventions.
"""
