"""Which light-transport effects a scene needs, by measured evidence.

Some modules measure how images change without an effect (radiance under a plan, image errors, gradients) and how much
work the effect takes. ``probe`` compares this with a tolerance and decides, ``planner`` does so during training, and
``new_light`` for relighting. The decision is a ``radiogs_core.transport.plan.EffectPlan``.
"""
