"""``radiogs-bench completion``: a script with which a shell completes commands, options, names and paths."""

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .options import add_verbose

if TYPE_CHECKING:
    from .options import Commands

SHELLS = ("bash", "zsh", "fish")

HELP = """Write it where the shell looks for such scripts:
  bash  radiogs-bench completion bash > ~/.local/share/bash-completion/completions/radiogs-bench
  zsh   radiogs-bench completion zsh > DIR/_radiogs-bench   (DIR: one of $fpath)
  fish  radiogs-bench completion fish > ~/.config/fish/completions/radiogs-bench.fish
It has the names of suites, scenes and methods that are installed now: write it again when they change."""


def add_to(commands: "Commands") -> None:
    """Declare the command."""
    parser = commands.add_parser(
        "completion",
        help="write a script with which a shell completes commands, options and names",
        epilog=HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.set_defaults(command=completion)
    parser.add_argument("shell", choices=SHELLS, metavar="SHELL", help=", ".join(SHELLS))
    add_verbose(parser)


def completion(options: argparse.Namespace) -> int:
    """Print the script."""
    import shtab

    from .parser import build_parser

    parser = build_parser()
    words, or_paths = _words(), _words_or_paths()
    for action in _actions(parser):
        if action.dest in words and action.choices is None:
            action.choices = words[action.dest]
        elif action.dest in or_paths:
            action.complete = {shell: _function(action.dest) for shell in SHELLS} | {"fish": shtab.FILE["fish"]}
        elif action.type is Path:
            action.complete = shtab.FILE
    functions = "\n".join(_DEFINED[options.shell](_function(name), found) for name, found in or_paths.items())
    sys.stdout.write(shtab.complete(parser, options.shell, preamble=functions))
    return 0


def _words() -> dict[str, list[str]]:
    """What options may be given that take one of some names, by the options' own names."""
    from ..scoring.metrics import PROTOCOLS

    return {"protocol": list(PROTOCOLS), "preset": ["smoke", "tiny", "small", "paper"]}


def _words_or_paths() -> dict[str, list[str]]:
    """The names of what may also be given as a path."""
    from radiogs_datasets import known_names

    from ..methods import method_names
    from ..suites.registry import SUITES

    scenes, methods = list(known_names()), list(method_names())
    return {"suite": list(SUITES), "scene": scenes, "scenes": scenes, "method": methods}


def _function(name: str) -> str:
    """The shell function that completes a name or a path."""
    return f"_radiogs_bench_{name}"


_DEFINED: dict[str, Callable[[str, Iterable[str]], str]] = {
    "bash": lambda name, words: f'{name}() {{ compgen -W \'{" ".join(words)}\' -- "$1"; compgen -f -- "$1"; }}',
    "zsh": lambda name, words: f"{name}() {{ _alternative 'names:name:({' '.join(words)})' 'files:file:_files' }}",
    "fish": lambda name, words: "",
}
"""How a shell defines such a function."""


def _actions(parser: argparse.ArgumentParser) -> Iterator[Any]:
    """All arguments of the parser and of the commands below it."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from _actions(below)
        else:
            yield action
