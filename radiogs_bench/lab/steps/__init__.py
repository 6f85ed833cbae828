"""Measures single steps, starting points and relit frames of a method at named sizes (``bench steps``)."""
