"""What a run costs and what its guards did: work counters, seconds of named parts, checks for finiteness."""

from .recording import Instruments, Recorded, count, current, fire, part, recording

__all__ = ["Instruments", "Recorded", "count", "current", "fire", "part", "recording"]
