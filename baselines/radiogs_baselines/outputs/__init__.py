"""Reading the folders that public codes write their results into: what is there, by view, as it appears on black."""

from .codes import CODES, Code
from .predictions import Predictions
from .reading import likely_codes, read_predictions

__all__ = ["CODES", "Code", "Predictions", "likely_codes", "read_predictions"]
