"""Published methods, implemented anew on the primitives of ``radiogs_core`` (docs/baselines.md)."""
