"""Which light-transport effects a scene needs, by measured evidence.

``probe`` measures how images change without an effect (``probe_scene``, ``images``), and how much work the effect takes
(``plans``), and decides by a rule (``decision``, ``bounds``). ``training`` does so during training, ``new_light`` for
relighting, and ``probing`` for a scene's true surfaces or a trained model. The decision is a
``radiogs_core.transport.plan.EffectPlan``.
"""
