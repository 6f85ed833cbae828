"""Writes trained models and results for other programs: meshes, turntables, layouts of other codes, loggers."""
