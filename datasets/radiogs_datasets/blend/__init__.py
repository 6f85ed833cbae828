"""Scenes with complete ground truth from .blend files, path-traced by Blender Cycles (extra ``blend``)."""
