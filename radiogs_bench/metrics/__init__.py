"""Metrics, each once, and the named protocols that bundle their conventions."""

from .protocol import PROTOCOLS, Protocol, protocol
from .values import PSNR_CAP, Value

__all__ = ["PROTOCOLS", "PSNR_CAP", "Protocol", "Value", "protocol"]
