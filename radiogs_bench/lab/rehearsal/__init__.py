"""Rehearses long runs: every phase at full size with few steps, and a forecast of the whole."""
