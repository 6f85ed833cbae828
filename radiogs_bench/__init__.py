"""The harness: command line, suites, cells, store, statistics, metrics."""
