"""Triangle meshes from rendered depth maps: fusion into a truncated signed distance field, and its zero level."""
