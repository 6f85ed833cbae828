"""Ctrl-C as a request: the step in progress ends, the state is written, then the run stops."""

import signal
from types import FrameType, TracebackType

from ..errors import Interrupted

STOPPING_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interruption:
    """Context in which the first Ctrl-C (or SIGTERM) requests a stop; a second one stops at once."""

    def __init__(self) -> None:
        self.requested = False

    def __enter__(self) -> "Interruption":
        self._before = {which: signal.signal(which, self._ask) for which in STOPPING_SIGNALS}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for which, handler in self._before.items():
            signal.signal(which, handler)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        if self.requested:
            raise KeyboardInterrupt
        self.requested = True

    def check(self) -> None:
        """Raise Interrupted if a stop was requested. To be called where all state is consistent."""
        if self.requested:
            raise Interrupted(
                "stopped as asked",
                "Finished cells and the state of the unfinished one are on disk.",
                "Run the same command again: it continues where this run stopped.",
            )
