"""Metrics, each implemented once, and the named protocols that bundle their conventions."""
