"""A process that runs Blender (``in_blender``): it answers lines of JSON, one task at a time."""

import json
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from radiogs_core.errors import DataError, UsageError

from ..generate.probe import failure_of

PYTHON_VARIABLE = "RADIOGS_BENCH_BLENDER_PYTHON"
"""Names another Python that has ``bpy``: its wheels are for one version of Python each, and pin NumPy."""

LAST_LINES = 3
"""Number of lines of Blender's output in the message when its process ends unexpectedly."""

SERVE = "import sys; sys.path.insert(0, sys.argv[1]); from in_blender.worker import serve; serve(int(sys.argv[2]))"


def blender_python() -> str:
    """The Python that runs Blender."""
    return os.environ.get(PYTHON_VARIABLE) or sys.executable


def environment() -> dict[str, str]:
    """The environment of Blender's process, in which Python imports no module of the folder where it is started.

    By a variable, because another Python may be too old for the option ``-P``.
    """
    return os.environ | {"PYTHONSAFEPATH": "1"}


def require_blender() -> None:
    """Raise UsageError, with how to install it, unless ``import bpy`` works in a separate process."""
    reason = blender_failure()
    if reason is not None:
        raise UsageError(
            "Blender cannot be used as a Python module here",
            f"{blender_python()} -c 'import bpy' ended with: {reason}",
            "With Python 3.11:  pip install 'radiogs-bench[blend]';  or make an environment of Python 3.11 with"
            f"  pip install bpy  and name its interpreter in {PYTHON_VARIABLE}.",
        )


def blender_failure() -> str | None:
    """The last words of a trial import that failed; None if it worked."""
    return failure_of([blender_python(), "-c", "import bpy"], environment())


class Blender:
    """A Blender process, which ends when its context is left. Its output is written to ``log``."""

    def __init__(self, log: Path) -> None:
        self._log = log
        reading, writing = os.pipe()
        command = [blender_python(), "-c", SERVE, str(Path(__file__).parent), str(writing)]
        with log.open("ab") as printed:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=printed,
                stderr=printed,
                pass_fds=[writing],
                text=True,
                env=environment(),
            )
        os.close(writing)
        self._answers = os.fdopen(reading, encoding="utf-8")

    def __enter__(self) -> "Blender":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.wait()
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):  # a task that was never read
            self._process.stdin.close()
        self._answers.close()

    def ask(self, task: str, **given: Any) -> Any:
        """The answer to a task. Raises DataError with Blender's complaint, or if its process ended."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps({"task": task} | given) + "\n")
            self._process.stdin.flush()
            line = self._answers.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            lines = self._log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
            printed = " / ".join(lines[-LAST_LINES:])[:500] or "nothing"
            raise DataError(
                f"Blender's process ended by itself (exit code {self._process.wait()}) at the task '{task}'",
                f"It last printed: {printed}",
                f"What is finished is kept; the same command goes on. All that it printed is in {self._log}.",
            )
        answer = json.loads(line)
        if "error" in answer:
            raise DataError(*(answer["error"][part] for part in ("what", "why", "remedy")))
        return answer["done"]
