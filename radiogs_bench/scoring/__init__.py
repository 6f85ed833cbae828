"""Renders and scores trained models, and scores the output of other codes."""
