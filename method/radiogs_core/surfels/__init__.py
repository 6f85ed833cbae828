"""Gaussian surfels: their parameters, files, starting points, density control and optimiser."""
