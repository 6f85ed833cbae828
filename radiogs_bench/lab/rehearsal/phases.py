"""Phases of a run: what each took, what memory it peaked at, and how often the whole run has it."""

import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import torch

from ...store.provenance import peak_memory, reset_peaks, wait_for

Result = TypeVar("Result")

MEMORY_MESSAGES = ("out of memory", "can't allocate memory", "not enough memory")
"""Messages of PyTorch's allocators on a GPU and on a CPU, in lower case."""


@dataclass(frozen=True)
class Phase:
    """A kind of work of a run."""

    title: str
    key: str
    """Stage or model that it belongs to; rows that share it do this work once."""
    seconds: tuple[float, ...]
    """Seconds of each repetition."""
    whole: int
    """Number of repetitions in the whole run."""
    peaks: Mapping[str, int]
    """Peak bytes by kind of memory ("host": resident set of the process, "device": CUDA allocator)."""
    extended_error: float | None = None
    """Standard error of extrapolated seconds; None for measured ones."""

    @property
    def mean(self) -> float:
        """Mean seconds of a repetition."""
        return math.fsum(self.seconds) / len(self.seconds)

    @property
    def error(self) -> float:
        """Standard error of the mean, seconds; zero for a single repetition."""
        if self.extended_error is not None:
            return self.extended_error
        count = len(self.seconds)
        return statistics.stdev(self.seconds) / math.sqrt(count) if count > 1 else 0.0


class TooLarge(Exception):
    """A phase, whose title is the text, asked for more memory than there is."""


@dataclass
class Phases:
    """The measured phases in order; ``clock`` may count only seconds for which the process had a core."""

    device: torch.device
    clock: Callable[[], float] = time.perf_counter
    say: Callable[[str], None] = lambda line: None
    done: list[Phase] = field(default_factory=list)

    def measure(self, title: str, key: str, whole: int, do: Callable[[], Result]) -> Result:
        """Do something once. Raises TooLarge where memory does not suffice."""
        self.begin()
        result, seconds = self.timed(title, do)
        self.end(title, key, whole, [seconds])
        return result

    def begin(self) -> None:
        """Reset the peaks of memory."""
        reset_peaks(self.device)

    def timed(self, title: str, do: Callable[[], Result]) -> tuple[Result, float]:
        """The result and the seconds, with the device idle before and after. Raises TooLarge."""
        wait_for(self.device)
        started = self.clock()
        try:
            result = do()
        except Exception as error:
            if of_memory(error):
                raise TooLarge(title) from error
            raise
        wait_for(self.device)
        return result, self.clock() - started

    def end(self, title: str, key: str, whole: int, seconds: Sequence[float]) -> None:
        """Store a phase with the peaks since ``begin``."""
        self.done.append(Phase(title, key, tuple(seconds), whole, peak_memory(self.device)))
        self.say(f"{title}: {self.done[-1].mean:.2f} s, {self.done[-1].peaks['host'] / 2**30:.2f} GiB")


def of_memory(error: BaseException | None) -> bool:
    """Whether an exception, or a cause of it, reports a lack of memory."""
    while error is not None:
        if isinstance(error, (MemoryError, torch.cuda.OutOfMemoryError)):
            return True
        if isinstance(error, RuntimeError) and any(text in str(error).lower() for text in MEMORY_MESSAGES):
            return True
        error = error.__cause__
    return False
