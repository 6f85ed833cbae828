"""The folders that public codes write their results into: read as maps on black, and written in their place."""

from .codes import CODES, Code
from .predictions import Predictions
from .reading import likely_codes, read_predictions
from .writing import LayoutWriter

__all__ = ["CODES", "Code", "LayoutWriter", "Predictions", "likely_codes", "read_predictions"]
