"""Commands and options. Nothing heavy is imported here, so that ``--help`` answers at once."""

import argparse
from importlib.metadata import version
from pathlib import Path
from typing import NoReturn

from radiogs.errors import UsageError

EXIT_CODES_HELP = """exit codes: 0 done; 1 a cell failed; 2 the command is wrong; 3 data is missing or malformed;
4 a non-finite value was caught; 130 stopped by Ctrl-C"""


class ExplainingParser(argparse.ArgumentParser):
    """Reports wrong usage as every other error of the program is reported."""

    def error(self, message: str) -> NoReturn:
        """Raise UsageError instead of printing and leaving."""
        raise UsageError(message, self.format_usage().strip(), f"All options:  {self.prog} --help")


def names(text: str) -> list[str]:
    """A list separated by commas."""
    return [name for name in text.split(",") if name]


def positive(text: str) -> int:
    """A whole number above zero."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number above zero")
    return int(text)


def build_parser() -> argparse.ArgumentParser:
    """The whole command line; ``command`` of the parsed options is the function to call with them."""
    parser = ExplainingParser(
        prog="radiogs-bench",
        description="Benchmark harness for Gaussian-surfel inverse rendering, with RadioGS.",
        epilog=EXIT_CODES_HELP,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"radiogs-bench {version('radiogs-bench')}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    _add_run(commands)
    _add_status(commands)
    _add_report(commands)
    _add_datasets(commands)
    return parser


def _add_run(commands: "argparse._SubParsersAction[ExplainingParser]") -> None:
    from . import run

    parser = commands.add_parser("run", help="run a suite, or continue it", allow_abbrev=False)
    parser.set_defaults(command=run.run)
    parser.add_argument("suite", nargs="?", metavar="SUITE", help="see --list")
    parser.add_argument("--list", action="store_true", help="list the suites and leave")
    parser.add_argument("--scenes", type=names, metavar="A,B", help="scene names or folders (default: the suite's)")
    parser.add_argument("--seeds", type=positive, default=1, metavar="N", help="run seeds 0 to N-1 (default: 1)")
    parser.add_argument("--preset", default="tiny", help="budget: smoke, tiny, small, paper (default: tiny)")
    parser.add_argument("--protocol", default="default", help="metric protocol (default: default)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder of the results (default: out/SUITE)")
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu", help="(default: cpu)")
    parser.add_argument("--threads", type=positive, metavar="N", help="CPU threads (default: all cores)")
    parser.add_argument("--dry-run", action="store_true", help="list the cells and what they will take, run nothing")
    _add_verbose(parser)


def _add_status(commands: "argparse._SubParsersAction[ExplainingParser]") -> None:
    from . import stored

    parser = commands.add_parser("status", help="what a folder of results holds", allow_abbrev=False)
    parser.set_defaults(command=stored.status)
    parser.add_argument("out", type=Path, metavar="OUT")
    _add_verbose(parser)


def _add_report(commands: "argparse._SubParsersAction[ExplainingParser]") -> None:
    from . import stored

    parser = commands.add_parser("report", help="rebuild tables and figures from stored results", allow_abbrev=False)
    parser.set_defaults(command=stored.report)
    parser.add_argument("out", type=Path, metavar="OUT")
    _add_verbose(parser)


def _add_datasets(commands: "argparse._SubParsersAction[ExplainingParser]") -> None:
    from . import datasets

    parser = commands.add_parser("datasets", help="list, check and generate scenes", allow_abbrev=False)
    actions = parser.add_subparsers(title="actions", required=True, metavar="ACTION")
    listing = actions.add_parser("list", help="scenes that are at hand", allow_abbrev=False)
    listing.set_defaults(command=datasets.list_scenes)
    check = actions.add_parser("check", help="read every file of a scene", allow_abbrev=False)
    check.set_defaults(command=datasets.check)
    check.add_argument("scene", metavar="PATH", help="scene name or folder")
    generate = actions.add_parser("generate", help="path-trace miniature scenes ([generate])", allow_abbrev=False)
    generate.set_defaults(command=datasets.generate)
    generate.add_argument("names", nargs="+", metavar="NAME")
    generate.add_argument("--out", type=Path, default=Path("out/scenes"), metavar="DIR", help="(default: out/scenes)")
    generate.add_argument("--seed", type=int, default=0, help="of the path tracer (default: 0)")
    for action in (listing, check, generate):
        _add_verbose(action)


def _add_verbose(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--verbose", action="store_true", help="log what happens, and tracebacks of errors")
