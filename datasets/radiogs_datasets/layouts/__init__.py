"""Loaders of scenes, one for each layout; all return the same ``Scene``."""
