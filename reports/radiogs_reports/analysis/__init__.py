"""What a run's stored values say: paired differences, ranks, Pareto fronts, cost, audit, fine-tuning.

Computes values, sentences and grids; ``write``, ``figures`` and ``page`` show them.
"""
