"""K16: the plane sweep that starting points come from."""
