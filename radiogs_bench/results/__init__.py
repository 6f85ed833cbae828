"""Reads stored results: the summary that reports are made from, the paper's tables, the gate."""
