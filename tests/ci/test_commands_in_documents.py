"""Every command that README and docs show is one that the command line takes."""

import re
import shlex
from pathlib import Path

import pytest

from radiogs_bench.cli.main import app, parsed
from radiogs_core.errors import UsageError

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```(?:sh|bash|console)\n(.*?)^```", re.MULTILINE | re.DOTALL)
COMMAND = re.compile(r"^(?:\.venv/bin/)?radiogs-bench (?P<arguments>.*)$", re.MULTILINE)
GRAMMAR = re.compile(r"[\[|]|\.\.\.")
"""Characters of a synopsis that a command does not have."""


def commands() -> list[tuple[str, str]]:
    """Document and arguments of every command in a shell block; backslashes join lines, comments are left out."""
    found = []
    for document in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))):
        for block in BLOCK.findall(document.read_text()):
            for match in COMMAND.finditer(block.replace("\\\n", " ")):
                arguments = re.split(r"\s#|\s[>&|]|;", match["arguments"])[0].strip()
                if not GRAMMAR.search(arguments):
                    found.append((document.name, arguments))
    return found


def test_there_are_many() -> None:
    assert len([each for each in commands() if each[0] == "README.md"]) == 5
    assert len([each for each in commands() if each[0] == "commands.md"]) > 25
    assert len({arguments.split()[0] for _, arguments in commands()}) > 12


@pytest.mark.parametrize(("document", "arguments"), commands())
def test_the_command_line_takes_it(document: str, arguments: str) -> None:
    numbered = re.sub(r"\bN\b", "3", arguments)
    try:
        parsed(app, [word for word in shlex.split(numbered) if word != "--verbose"])
    except UsageError as error:
        pytest.fail(f"{document}: radiogs-bench {arguments}: {error}")
