"""What a run costs and what its guards did: work counters, seconds of named parts, checks for finiteness."""
