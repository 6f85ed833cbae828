"""Lenses that bend straight lines, and pinhole images made of what they saw."""
