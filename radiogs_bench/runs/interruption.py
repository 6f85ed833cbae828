"""Ctrl-C as a request: the step in progress ends, the state is written, then the run stops."""

import os
import signal
from types import FrameType

from ..errors import Interrupted, StoppedAtOnce

STOPPING_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

STREAMS = (1, 2)
"""File descriptors that a closed terminal leaves without a reader."""


class Interruption:
    """Context: the first Ctrl-C (SIGTERM, closed terminal) requests a stop, and a second one stops at once.

    Closed terminals are ignored under ``nohup``.
    """

    def __init__(self) -> None:
        self.requested = False

    def __enter__(self) -> "Interruption":
        heard = [which for which in STOPPING_SIGNALS if signal.getsignal(which) is not signal.SIG_IGN]
        self._before = {which: signal.signal(which, self._ask) for which in heard}
        self._terminals = [stream for stream in STREAMS if os.isatty(stream)]
        return self

    def __exit__(self, *error: object) -> None:
        for which, handler in self._before.items():
            signal.signal(which, handler)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        if number == signal.SIGHUP:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            for stream in self._terminals:  # every further word would end in an error
                os.dup2(nowhere, stream)
            os.close(nowhere)
            self.requested = True
            return
        if self.requested:
            raise StoppedAtOnce
        self.requested = True

    def check(self) -> None:
        """Raise Interrupted if a stop was requested. Call it only where all state is consistent."""
        if self.requested:
            raise Interrupted(
                "stopped as asked",
                "Finished cells and the state of the unfinished one are on disk.",
                "Run the same command again: it continues where this run stopped.",
            )
