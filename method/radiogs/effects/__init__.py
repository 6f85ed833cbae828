"""Simulating only the effects that a scene calls for: a plan, the evidence for it, and how both come about.

``plan`` says what is simulated. ``subject``, ``candidates``, ``images``, ``gradient`` and ``staleness`` measure what
leaving something out would change; ``bounds``, ``tolerance`` and ``decision`` judge it; ``probe`` puts them together,
and ``planner`` does so again during training.
"""
