"""Suites as data: which variants of the method are run, what is measured, what stands beside it."""
