"""``--trust FILE``: runs the commands of a method's file that only a folder of results or a suite names."""

import argparse
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ..errors import visible
from ..trusted_methods import SUFFIX, trusting
from .reporter import complain

if TYPE_CHECKING:
    from radiogs_baselines.commands.file import MethodFile


def add_trust(parser: argparse.ArgumentParser) -> None:
    """Add ``--trust``, for commands that open what may name a method's file."""
    parser.add_argument(
        "--trust", type=method_file, action="append", default=[], metavar="FILE",
        help="Print and run the commands of this method's file, which the model or the suite names. This option may be"
        " repeated.",
    )  # fmt: skip


def method_file(text: str) -> str:
    """The path of a method's file."""
    if not text.endswith(SUFFIX):
        raise argparse.ArgumentTypeError(f"'{text}' does not end in {SUFFIX}, as methods' files do")
    return text


@contextmanager
def trusting_named(options: argparse.Namespace) -> Iterator[None]:
    """Trust the methods' files that the command line names; prints the commands of those that ``--trust`` names.

    Raises DataError for a file that cannot be read, UsageError for a wrong one.
    """
    method, named = getattr(options, "method", None) or [], getattr(options, "name", None) or []
    chosen = [*([method] if isinstance(method, str) else method), *([named] if isinstance(named, str) else named)]
    with trusting(chosen), trusting(getattr(options, "trust", [])) as added:
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
