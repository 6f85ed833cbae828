"""What brings the cells of a sweep to their end: this process, a pool, a cluster."""
