"""Suites as data: which methods and variants are run, what is measured, which published table is shown beside it."""
