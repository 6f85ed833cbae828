"""The command line ``radiogs-bench``: parses, runs the command, and turns failures into messages and exit codes.

Each command is a function: its parameters are its arguments and options, its docstring is their help. A module of
commands is imported when one of them is called, and imports nothing heavy at the top: ``--help`` answers at once.
"""

import logging
import os
import shlex
import sys
from collections import ChainMap
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import is_dataclass
from inspect import BoundArguments
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, CycloptsError, Group, Parameter, UnusedCliTokensError

from radiogs_core.errors import ExplainedError, UsageError

from ..errors import UNEXPECTED, Interrupted, exit_code, explain, visible
from ..sources import version_and_commit
from ..trusted_methods import trusting
from .options import OPTIONS
from .reporter import VisibleFormatter, complain, complain_with_trace
from .values import read

if TYPE_CHECKING:
    from radiogs_baselines.commands.file import MethodFile

PURPOSE = """Benchmark harness for Gaussian-surfel inverse rendering, with RadioGS.

Exit codes: 0 done; 1 a cell failed, or the gate found a regression; 2 the command is wrong; 3 data is missing or
malformed; 4 a non-finite value was caught; 5 files have to be fetched by hand; 6 something else ended it: a folder that
cannot be read or written, killed processes, an unexpected error; 130 stopped by Ctrl-C."""

COMMANDS = {
    "run": "run:run",
    "status": "status:status",
    "rehearse": "rehearse:rehearse",
    "verify": "stored:verify",
    "report": "stored:report",
    "export": "export:export",
    "gate": "stored:gate",
    "record": "record:record",
    "publish": "record:publish",
    "methods": "methods:methods",
    "train": "model:train",
    "render": "model:render",
    "relight": "relight:relight",
    "probe": "probe:probe",
    "view": "view:view",
    "score": "score:score",
    "datasets": "datasets:datasets",
    "bench": "bench:bench",
    "completion": "main:completion",
}
"""The module of each command, and its function or the group of its actions, in the order of the help."""


def shown_default(value: Any) -> str | None:
    """The default value that an option's help prints; None for a flag or an option without a default."""
    if value is None or value is False or value in ("", (), {}):
        return None
    return ",".join(map(str, value)) if isinstance(value, tuple) else str(value)


app = App(
    name="radiogs-bench",
    help=PURPOSE,
    version=lambda: f"radiogs-bench {version_and_commit()}",
    group_parameters=OPTIONS,
    default_parameter=Parameter(converter=read, negative=(), allow_repeating=True, show_default=shown_default),
)
for place, (name, path) in enumerate(COMMANDS.items()):
    app.command(f"{__package__}.{path}", name=name, sort_key=place)


@app.meta.default
def launch(
    *words: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    verbose: Annotated[bool, Parameter(group=Group("Everywhere", sort_key=2))] = False,
) -> int:
    """Run the command with the methods' files that it names trusted, and ``--data`` as the root of data if given.

    :param verbose: Print a log, and the tracebacks of errors.
    """
    command, given = parsed(app, words)
    if "words" in given.signature.parameters:
        given.arguments["words"] = words
    values = values_of(given)
    with trusting_named(values), _using_data(values):
        return int(command(*given.args, **given.kwargs) or 0)


def values_of(given: BoundArguments) -> dict[str, Any]:
    """Values of the arguments and options that were given, by name; of a group of options, all its values."""
    groups = [vars(value) for value in given.arguments.values() if is_dataclass(value)]
    return dict(ChainMap({**given.arguments}, *groups))


@contextmanager
def trusting_named(given: Mapping[str, Any]) -> Iterator[None]:
    """Trust a command's methods' files, and print commands of those in ``trust``. Raises DataError or UsageError."""
    named = given.get("method") or ()
    chosen = (named,) if isinstance(named, str) else named
    with trusting(chosen), trusting(given.get("trust", ())) as added:
        for path, found in added.items():
            complain(f"{visible(str(path))} is trusted and may run:")
            for line in commands_of(found.file):
                complain(f"  {line}")
        yield


def commands_of(file: "MethodFile") -> list[str]:
    """The commands of a method's file, its environment and settings: a line each, of visible characters alone."""
    lists = {f"train, {each.name}": (*each.arguments, *each.resume) for each in file.train}
    lists |= {name: each.arguments for name in ("render", "relight") if (each := getattr(file, name)) is not None}
    lists |= {"in the folder": (file.working_folder,)}
    lists |= {f"with {name}": (value,) for name, value in file.environment.items()}
    lists |= {f"{{{name}}}": values for name, values in file.settings.items()}
    lists |= {f"{{{name}}} for {scene}": of for scene, own in file.scenes.items() for name, of in own.items()}
    return [visible(f"{name}: {shlex.join(words)}").replace("\n", r"\n") for name, words in lists.items()]


def parsed(by: App, words: Sequence[str]) -> tuple[Callable[..., Any], BoundArguments]:
    """The function that a command line calls, and its arguments. Raises UsageError for an invalid line."""
    try:
        command, given, _ = by.parse_args(words, exit_on_error=False, print_error=False)
    except CycloptsError as error:
        raise usage_error(error) from error
    return command, given


def usage_error(error: CycloptsError) -> UsageError:
    """The error for a wrong line, explained as other errors are."""
    error.verbose = False
    what = str(error).replace('"', "'")
    if isinstance(error, UnusedCliTokensError):
        what = f"there is no place for {' '.join(error.unused_tokens or ())}"
    command = " ".join([*app.name, *(error.command_chain or ())])
    return UsageError(what, "", f"All options:  {command} --help")


def _using_data(given: Mapping[str, Any]) -> AbstractContextManager[None]:
    if given.get("data") is None:
        return nullcontext()
    from radiogs_datasets.data_root import using_data_root

    return using_data_root(given["data"], planned=given.get("dry_run", False))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the process's exit code (see ``errors``)."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    return answered(lambda: execute(given), "--verbose" in given)


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


def execute(words: Sequence[str]) -> int:
    """Execute a command line; returns its exit code. Raises UsageError for a wrong line, and the command's errors."""
    if not words or words[0] in app.help_flags:
        app.resolved_commands()  # the list of commands has a sentence of each
    command, given = parsed(app.meta, words)
    return int(command(*given.args, **given.kwargs) or 0)


def completion(shell: Literal["bash", "zsh", "fish"], /) -> None:
    """Print a script with which a shell completes commands, options and names.

    Write the script where the shell looks for such scripts. It asks the program for the names of suites, scenes and
    methods.

        radiogs-bench completion bash > ~/.local/share/bash-completion/completions/radiogs-bench
        radiogs-bench completion zsh > DIR/_radiogs-bench   (DIR: one of $fpath)
        radiogs-bench completion fish > ~/.config/fish/completions/radiogs-bench.fish

    Example:  radiogs-bench completion bash

    :param shell: Complete in this shell.
    """
    script = app.generate_completion(shell=shell)
    # Bash gets quoted words; a comma stays as it is, for the next name of a list to follow it.
    sys.stdout.write(script.replace('"$_x"; COMPREPLY', '"$_x"; _q="${_q//\\\\,/,}"; COMPREPLY'))
