"""The whole command line; each command declares its options beside what it does.

Those modules import nothing heavy at the top, so that ``--help`` answers at once.
"""

from importlib.metadata import version

from . import bench, completion, datasets, gate, methods, model, probe, rehearse, run, score, status, stored, view
from .options import ExplainingParser

EXIT_CODES_HELP = """exit codes: 0 done; 1 a cell failed, or the gate found a regression; 2 the command is wrong;
3 data is missing or malformed; 4 a non-finite value was caught; 5 files have to be fetched by hand; 6 something else
ended it: a folder that cannot be read or written, killed processes, an unexpected error; 130 stopped by Ctrl-C"""

COMMANDS = (run, status, rehearse, stored, gate, methods, model, probe, view, score, datasets, bench, completion)


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
    for command in COMMANDS:
        command.add_to(commands)
    return parser
