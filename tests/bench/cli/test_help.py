"""``--help`` of every command: sentences that stand alone, and an example that the command takes."""

import re
import shlex
from collections.abc import Iterator

import pytest
from cyclopts import App

from radiogs_bench.cli import main
from radiogs_bench.cli.main import COMMANDS, app, parsed

EXAMPLE = re.compile(r"^Example:  radiogs-bench (.+)$", re.MULTILINE)


def commands(of: App, name: str = "") -> Iterator[tuple[str, App]]:
    """Every command, and every action below it, by its name."""
    for each, below in of.resolved_commands().items():
        if not each.startswith("-"):
            yield f"{name}{each}", below
            yield from commands(below, f"{name}{each} ")


ALL = dict(commands(app))


def is_sentence(text: str | None) -> bool:
    return text is not None and text[0].isupper() and text.endswith(".")


def test_every_command_of_the_table_is_there_in_its_order() -> None:
    assert [name for name in ALL if " " not in name] == list(COMMANDS)
    assert len(ALL) > 28


@pytest.mark.parametrize("name", ALL)
def test_every_command_and_option_is_explained_by_sentences(name: str) -> None:
    purpose, *_ = ALL[name].help.split("\n\n")
    assert is_sentence(purpose.strip())
    for argument in ALL[name].assemble_argument_collection(parse_docstring=True) if ALL[name].default_command else ():
        if argument.show and not argument.children:
            assert is_sentence(argument.parameter.help), f"{name} {argument.name}: {argument.parameter.help}"


@pytest.mark.parametrize("name", ALL)
def test_the_example_of_a_command_is_one_that_it_takes(name: str) -> None:
    """The example of a command with actions names one of its actions."""
    (words,) = EXAMPLE.findall("\n".join(line.strip() for line in ALL[name].help.splitlines()))
    assert words.startswith(name)
    command, _ = parsed(app, shlex.split(words))
    assert ALL[name].default_command in (None, command), "a command of this name runs"


@pytest.mark.parametrize("name", ["", *ALL])
def test_the_help_of_every_command_can_be_printed(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*name.split(), "--help"]) == 0
    said = capsys.readouterr().out
    assert f"Usage: radiogs-bench {name}".strip() in said
    assert "--verbose" in said
    assert ("Example:" in said) == bool(name)
