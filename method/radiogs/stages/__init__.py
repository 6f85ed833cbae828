"""The two training stages: initialisation (split-sum) and inverse rendering (Monte-Carlo consistency)."""

from .initialise import Initialisation
from .invert import InverseRendering

__all__ = ["Initialisation", "InverseRendering"]
