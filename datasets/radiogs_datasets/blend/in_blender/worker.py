"""The process: tasks come as lines of JSON on standard input, answers go as lines of JSON where it was told.

    python -c "... ; from in_blender.worker import serve; serve(DESCRIPTOR)"

Blender and its libraries print what they like to standard output and standard error, so answers have a pipe of their
own. An answer is ``{"done": ...}`` or ``{"error": {"what", "why", "remedy"}}``; the process ends with its input.
"""

import json
import os
import sys
from typing import Any

from . import authoring, materials, opening, picture, settings
from .errors import Unusable


def serve(descriptor: int) -> None:
    """Answer every line of standard input."""
    with os.fdopen(descriptor, "w", encoding="utf-8") as answers:
        for line in sys.stdin:
            try:
                answer: dict[str, Any] = {"done": _answer(json.loads(line))}
            except Unusable as error:
                answer = {"error": error.told}
            answers.write(json.dumps(answer) + "\n")
            answers.flush()


def _answer(task: dict[str, Any]) -> Any:
    kind = task["task"]
    if kind == "open":
        found = opening.open_file(task["file"])
        settings.prepare(task["device"], task["threads"])
        materials.declare()
        return found | materials.translate_all()
    if kind == "render":
        return picture.take(task)
    if kind == "author":
        return authoring.write(task["description"], task["out"])
    raise ValueError(kind)
