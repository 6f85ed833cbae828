"""Engines run the cells of a sweep: in this process, in a pool, on a cluster."""
