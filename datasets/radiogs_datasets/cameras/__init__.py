"""Cameras as files say them: transforms files, COLMAP's models, and lenses that bend straight lines."""
