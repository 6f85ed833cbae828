"""K1: rasterizes surfels: binned by tile, blended front to back."""
