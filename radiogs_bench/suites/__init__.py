"""Suites as data: which methods and variants are run, which metrics are measured, which published table is shown."""
