"""The command line ``radiogs-bench``: parses, runs the command, and turns failures into messages and exit codes.

Each command declares its options beside what it does, in a module that imports nothing heavy at the top: ``--help``
answers at once. Only ``completion`` is here, because it reads the options of all commands.
"""

import argparse
import logging
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radiogs_core.errors import ExplainedError

from ..errors import UNEXPECTED, Interrupted, exit_code, explain
from . import (
    bench,
    datasets,
    export,
    methods,
    model,
    probe,
    record,
    rehearse,
    relight,
    run,
    score,
    status,
    stored,
    view,
)  # fmt: skip
from .options import ExplainingParser, add_verbose
from .reporter import VisibleFormatter, complain, complain_with_trace
from .trusting import trusting_named

if TYPE_CHECKING:
    from .options import Commands

EXIT_CODES_HELP = """exit codes: 0 done; 1 a cell failed, or the gate found a regression; 2 the command is wrong;
3 data is missing or malformed; 4 a non-finite value was caught; 5 files have to be fetched by hand; 6 something else
ended it: a folder that cannot be read or written, killed processes, an unexpected error; 130 stopped by Ctrl-C"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the process's exit code (see ``errors``)."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    return answered(lambda: _command(given), "--verbose" in given)


def _command(given: list[str]) -> int:
    if not given:
        build_parser().print_help()
        return 0
    options = build_parser().parse_args(given)
    options.arguments = given
    return execute(options)


def answered(command: Callable[[], int], verbose: bool) -> int:
    """Run a command; prints an error that ends it, and returns the exit code."""
    shown = logging.StreamHandler(sys.stderr)
    shown.setFormatter(VisibleFormatter("%(levelname)s: %(message)s"))
    logging.basicConfig(level=logging.DEBUG if verbose else logging.WARNING, handlers=[shown])
    logging.getLogger().setLevel(logging.WARNING)
    logging.getLogger("radiogs_bench").setLevel(logging.DEBUG if verbose else logging.WARNING)
    try:
        return command()
    except KeyboardInterrupt:
        error: ExplainedError = Interrupted("stopped at once", "", "Run the same command again: it continues.")
    except BrokenPipeError:
        # The reader (head, less) went away; Python would complain once more when it flushes stdout at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141  # 128 + SIGPIPE
    except ExplainedError as raised:
        error = raised
        if verbose:
            complain_with_trace()
    except Exception as unexpected:  # noqa: BLE001  an exit code of its own; the traceback is printed
        complain_with_trace()
        complain(
            f"error: unexpected: {type(unexpected).__name__}\nWhat was finished before is on disk.\n"
            f"Please report it with the lines above.\n(exit code {UNEXPECTED})"
        )
        return UNEXPECTED
    complain(explain(error))
    return exit_code(error)


def execute(options: argparse.Namespace) -> int:
    """Run the command with the methods' files that it names trusted, and ``--data`` as the root of data if given."""
    with trusting_named(options):
        return _execute(options)


def _execute(options: argparse.Namespace) -> int:
    if getattr(options, "data", None) is None:
        return int(options.command(options))
    from radiogs_datasets.data_root import using_data_root

    with using_data_root(options.data, planned=getattr(options, "dry_run", False)):
        return int(options.command(options))


def build_parser() -> ExplainingParser:
    """Every command's options; ``command`` of the parsed options is the function to call with them."""
    parser = ExplainingParser(
        prog="radiogs-bench",
        description="Benchmark harness for Gaussian-surfel inverse rendering, with RadioGS.",
        epilog=EXIT_CODES_HELP,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"radiogs-bench {version('radiogs-bench')}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for declare in (
        run.add_to, status.add_to, rehearse.add_to, stored.add_to, export.add_to, stored.add_gate, record.add_to,
        methods.add_to, model.add_to, relight.add_to, probe.add_to, view.add_to, score.add_to, datasets.add_to,
        bench.add_to, _add_completion,
    ):  # fmt: skip
        declare(commands)
    return parser


SHELLS = ("bash", "zsh", "fish")

COMPLETION_HELP = """Example:  write it where the shell looks for such scripts.
  bash  radiogs-bench completion bash > ~/.local/share/bash-completion/completions/radiogs-bench
  zsh   radiogs-bench completion zsh > DIR/_radiogs-bench   (DIR: one of $fpath)
  fish  radiogs-bench completion fish > ~/.config/fish/completions/radiogs-bench.fish
It has the names of suites, scenes and methods that are installed now: write it again when they change."""


def _add_completion(commands: "Commands") -> None:
    """Declare ``completion``."""
    purpose = "Print a script with which a shell completes commands, options and names."
    parser = commands.add_parser(
        "completion",
        help=purpose,
        description=purpose,
        epilog=COMPLETION_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.set_defaults(command=completion)
    parser.add_argument("shell", choices=SHELLS, metavar="SHELL", help="Complete in this shell: bash, zsh or fish.")
    add_verbose(parser)


def completion(options: argparse.Namespace) -> int:
    """Print the script with which a shell completes commands, options, names and paths."""
    import shtab

    parser = build_parser()
    words, or_paths = _words(), _words_or_paths()
    for command, action in _every_action(parser):
        name = f"{command} {action.dest}"
        if action.choices is None and (found := words.get(name, words.get(action.dest))):
            action.choices = found
        elif action.dest in or_paths or name in or_paths:
            complete = _function(name if name in or_paths else action.dest)
            action.complete = dict.fromkeys(SHELLS, complete) | {"fish": shtab.FILE["fish"]}
        elif action.type is Path:
            action.complete = shtab.FILE
    functions = "\n".join(_DEFINED[options.shell](_function(name), found) for name, found in or_paths.items())
    sys.stdout.write(shtab.complete(parser, options.shell, preamble=functions))
    return 0


def _words() -> dict[str, list[str]]:
    """The values of options that take one of some names, by option, or by command and option."""
    from radiogs_baselines.outputs.codes import CODES

    from ..fetching.catalogue import DATA_SETS
    from ..scoring.metrics.protocols import PROTOCOLS

    return {
        "protocol": list(PROTOCOLS), "preset": ["smoke", "tiny", "small", "paper"], "score code": list(CODES),
        "datasets fetch names": list(DATA_SETS),
    }  # fmt: skip


def _words_or_paths() -> dict[str, list[str]]:
    """The known names for options that also take a path or a list, by option, or by command and option."""
    from radiogs_datasets import known_names

    from ..installed_methods import method_names
    from ..suites.registry import SUITES

    scenes, methods = list(known_names()), list(method_names())
    return {"suite": list(SUITES), "scene": scenes, "scenes": scenes, "method": methods, "methods name": methods}


def _function(name: str) -> str:
    """The shell function that completes a name or a path."""
    return f"_radiogs_bench_{name.replace(' ', '_')}"


_DEFINED: dict[str, Callable[[str, Iterable[str]], str]] = {
    "bash": lambda name, words: (
        f'{name}() {{ local before=""; [[ $1 == *,* ]] && before="${{1%,*}},";'
        f' compgen -P "$before" -W \'{" ".join(words)}\' -- "${{1##*,}}"; compgen -f -- "$1"; }}'
    ),
    "zsh": lambda name, words: (
        f"{name}() {{ _alternative 'names:name:_sequence compadd - {' '.join(words)}' 'files:file:_files' }}"
    ),
    "fish": lambda name, words: "",
}
"""Definition of such a function, by shell. A name may follow others and a comma."""


def _every_action(parser: ExplainingParser) -> Iterator[tuple[str, Any]]:
    """All arguments of the parser and of the commands below it, each with its command."""
    for action in parser.arguments:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from _every_action(below)
        else:
            yield parser.prog.partition(" ")[2], action
