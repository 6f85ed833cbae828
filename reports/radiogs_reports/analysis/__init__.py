"""Analyses of a run's stored values: paired differences, ranks, Pareto fronts, cost, audit, fine-tuning.

They compute values, sentences and grids; ``write``, ``figures`` and ``page`` show them.
"""
