"""Which light-transport effects a scene needs, by measured evidence.

Some modules find what leaving an effect out would change (radiance under a plan, image errors, gradients) and what it
costs; ``probe``, ``planner`` and ``new_light`` compare that with a tolerance, once, during training and for relighting.
The decision itself is a ``radiogs_core.transport.plan.EffectPlan``.
"""
