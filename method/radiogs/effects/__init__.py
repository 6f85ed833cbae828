"""Which light-transport effects a scene needs, by measured evidence.

``measure`` finds what leaving an effect out would change and what it costs; ``decide`` compares that with a tolerance,
once or during training. The decision itself is a ``radiogs_core.transport.plan.EffectPlan``.
"""
