"""``--help`` of every command: sentences that stand alone, and an example that the command takes."""

import argparse
import shlex
from collections.abc import Iterator

import pytest

from radiogs_bench.cli.main import build_parser
from radiogs_bench.cli.options import ExplainingParser


def commands(parser: ExplainingParser) -> Iterator[ExplainingParser]:
    """Every command and every subject or action below it."""
    for action in parser.arguments:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield below
                yield from commands(below)


COMMANDS = {parser.prog.partition(" ")[2]: parser for parser in commands(build_parser())}


def is_sentence(text: str | None) -> bool:
    return text is not None and text[0].isupper() and text.endswith(".")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_and_option_is_explained_by_sentences(name: str) -> None:
    parser = COMMANDS[name]
    assert is_sentence(parser.description)
    for action in parser.arguments:
        grouping = isinstance(action, argparse._SubParsersAction | argparse._HelpAction)
        if action.help != argparse.SUPPRESS and not grouping:
            assert is_sentence(action.help), f"{name} {action.dest}: {action.help}"


@pytest.mark.parametrize("name", [name for name in COMMANDS if name != "completion"])
def test_the_example_of_a_command_is_one_that_it_takes(name: str) -> None:
    """The example of a command with subjects names one of these."""
    epilog = COMMANDS[name].epilog
    assert epilog is not None
    start, _, words = epilog.partition("radiogs-bench ")
    assert start == "Example:  "
    assert words.startswith(name)
    options = build_parser().parse_args(shlex.split(words))
    declared = COMMANDS[name].get_default("command")
    assert declared in (None, options.command), "a command of this name runs"


def test_the_help_of_every_command_can_be_printed() -> None:
    """A per cent sign in a text would end it."""
    for parser in COMMANDS.values():
        assert "Example:" in parser.format_help()


def test_the_list_of_commands_has_a_sentence_for_each() -> None:
    for parser in (build_parser(), *COMMANDS.values()):
        for action in parser.arguments:
            if isinstance(action, argparse._SubParsersAction):
                assert len(action._choices_actions) == len(action.choices)
                assert all(is_sentence(each.help) for each in action._choices_actions)
