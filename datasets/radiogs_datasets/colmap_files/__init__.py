"""COLMAP's sparse models: cameras, images and points, as binary files or as text."""

from .model import SparseModel, StoredCamera, StoredImage
from .reading import files_of, find_model, read_model

__all__ = ["SparseModel", "StoredCamera", "StoredImage", "files_of", "find_model", "read_model"]
