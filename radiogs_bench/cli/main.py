"""Entry: parse, run the command, and turn failures into three-part messages and exit codes."""

import argparse
import logging
import os
import sys
import traceback
from collections.abc import Sequence

from radiogs_core.errors import ExplainedError

from ..errors import UNEXPECTED, Interrupted, exit_code, explain
from .parser import build_parser
from .reporter import complain


def _run(options: argparse.Namespace) -> int:
    """Run the command, with ``--data`` as the root of data if it was given."""
    if getattr(options, "data", None) is None:
        return int(options.command(options))
    from radiogs_datasets.data_root import using_data_root

    with using_data_root(options.data):
        return int(options.command(options))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the process's exit code (see ``errors``)."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    verbose = "--verbose" in given
    logging.basicConfig(
        level=logging.DEBUG if verbose else logging.WARNING, format="%(levelname)s: %(message)s", stream=sys.stderr
    )
    logging.getLogger().setLevel(logging.WARNING)
    logging.getLogger("radiogs_bench").setLevel(logging.DEBUG if verbose else logging.WARNING)
    try:
        options = build_parser().parse_args(given)
        options.arguments = given
        return _run(options)
    except KeyboardInterrupt:
        error: ExplainedError = Interrupted("stopped at once", "", "Run the same command again: it continues.")
    except BrokenPipeError:
        # The reader (head, less) went away; Python would complain once more when it flushes stdout at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141  # 128 + SIGPIPE
    except ExplainedError as raised:
        error = raised
        if verbose:
            traceback.print_exc()
    except Exception as unexpected:  # noqa: BLE001  an exit code of its own; the traceback is printed
        traceback.print_exc()
        complain(
            f"error: unexpected: {type(unexpected).__name__}\nWhat was finished before is on disk.\n"
            f"Please report it with the lines above.\n(exit code {UNEXPECTED})"
        )
        return UNEXPECTED
    complain(explain(error))
    return exit_code(error)
