"""Analyses of a run's stored values: sentences and grids that ``write``, ``figures`` and ``page`` show."""
