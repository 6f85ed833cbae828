"""K1: surfels to pixels, binned by tile, blended front to back."""
