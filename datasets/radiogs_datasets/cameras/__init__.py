"""Cameras from files: transforms files, COLMAP models, and lenses with distortion."""
