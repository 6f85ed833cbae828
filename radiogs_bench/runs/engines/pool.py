"""A pool of processes on this machine: each runs the same sweep on the same store, and claims keep them apart.

A worker is the command itself with one more option, so it does exactly what a run does. If a worker dies, the work
since its last checkpoint is lost: its claim is released, and another worker continues the cell.
"""

import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from queue import Empty, SimpleQueue

from ..interruption import Interruption

POLL_SECONDS = 0.2


def run_pool(
    commands: Sequence[Sequence[str]],
    say: Callable[[str], None],
    look: Callable[[], None],
    interruption: Interruption,
) -> list[int]:
    """Run the commands side by side until all have ended; returns their exit codes.

    Their stderr goes to ``say`` line by line; ``look`` is called at intervals. A requested stop is passed on once and
    waited for, because workers write their state before they end.
    """
    lines: SimpleQueue[str] = SimpleQueue()
    workers = [
        subprocess.Popen(
            command,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            start_new_session=True,  # Ctrl-C reaches this process alone; it asks the workers once
        )
        for command in commands
    ]
    readers = [threading.Thread(target=_relay, args=(worker, lines), daemon=True) for worker in workers]
    for reader in readers:
        reader.start()
    asked = False
    try:
        while any(reader.is_alive() for reader in readers) or not lines.empty():
            try:
                say(lines.get(timeout=POLL_SECONDS))
            except Empty:
                look()
            if interruption.requested and not asked:
                asked = True
                for worker in workers:
                    worker.send_signal(signal.SIGTERM)
    finally:
        for worker in workers:
            if worker.poll() is None:
                worker.terminate()
    return [worker.wait() for worker in workers]


def _relay(worker: "subprocess.Popen[str]", lines: "SimpleQueue[str]") -> None:
    assert worker.stderr is not None
    with worker.stderr as stream:
        for line in stream:
            lines.put(line.rstrip("\n"))


def worker_commands(arguments: Sequence[str], workers: int, threads: int) -> list[list[str]]:
    """The command line of each worker: the user's, with the worker's number and its share of the threads."""
    share = max(1, threads // workers)
    own = [sys.executable, "-m", "radiogs_bench", *arguments, "--threads", str(share)]
    return [[*own, "--worker", f"{number}/{workers}"] for number in range(workers)]
