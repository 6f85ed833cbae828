"""Sentences on a terminal: wrapped between words, so that no number is cut, and no command is."""

import textwrap

BEFORE_COMMAND = "  radiogs-bench "
"""How a command to copy follows a sentence."""


def wrapped(line: str, width: int) -> str:
    """The line in lines of at most ``width`` characters; a longer word, and a command at the end, stay in one piece."""
    if len(line) <= width:
        return line
    sentence, before, command = line.partition(BEFORE_COMMAND)
    margin = line[: len(line) - len(line.lstrip())]
    lines = textwrap.wrap(
        sentence, width, subsequent_indent=margin, break_long_words=False, break_on_hyphens=False
    )  # fmt: skip
    return "\n".join([*lines, *([before + command] if before else [])])
