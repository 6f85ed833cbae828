"""Scoring what a model, or somebody else's code, has made."""
