"""Metrics, each implemented once, and the named protocols that bundle their conventions."""

from .protocol import Protocol, Scores
from .protocols import PROTOCOLS, protocol
from .values import PSNR_CAP, Value

__all__ = ["PROTOCOLS", "PSNR_CAP", "Protocol", "Scores", "Value", "protocol"]
