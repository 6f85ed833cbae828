"""Shared by the commands: the parser, the types of options' values, and options that several commands have."""

import argparse
import math
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from radiogs_core.errors import UsageError, did_you_mean

if TYPE_CHECKING:
    from radiogs_core.transport.plan import Effects
    from radiogs_datasets.options import SceneOptions

    from ..suites.suite import Suite

    Commands = argparse._SubParsersAction["ExplainingParser"]


METHOD = "radiogs"
"""The method that is trained and probed where none is named."""

MOST_SEEDS = 10_000
SMALLEST_PICTURE, LARGEST_PICTURE = 16, 8192
"""Pixels a side: the buffers that VTK draws into end near 16384, where it aborts the process."""

BARE_WORD = re.compile(r"[A-Za-z][\w.+-]*")
"""A value of ``--set`` that needs no quotes."""

LONGEST_COUNT = 18
"""Most digits of a whole number: every number of so many digits fits into 64 bits."""


NO_CHOICE = re.compile(r"invalid choice: '(?P<given>.*)' \(choose from (?P<choices>.*)\)")
"""The message of argparse for a value that is not among the choices."""


class ExplainingParser(argparse.ArgumentParser):
    """Reports wrong usage like every other error."""

    @property
    def arguments(self) -> Sequence[argparse.Action]:
        """The arguments and options that the command declares, subcommands as one of them."""
        return self._actions

    def error(self, message: str) -> NoReturn:
        """Raise UsageError instead of printing and exiting."""
        usage, help_is = self.format_usage().strip(), f"All options:  {self.prog} --help"
        wrong = NO_CHOICE.search(message)
        if wrong is not None:
            hint = did_you_mean(wrong["given"], [name.strip(" '") for name in wrong["choices"].split(",")])
            raise UsageError(message, usage, f"{hint} {help_is}".strip())
        raise UsageError(message, usage, help_is)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[argparse.Namespace, list[str]]:  # type: ignore[override]
        """Raise UsageError for an unknown option, with the nearest one of this command."""
        options, unknown = super().parse_known_args(args, namespace)
        if unknown:
            names = [name for action in self.arguments for name in action.option_strings]
            hint = did_you_mean(unknown[0].partition("=")[0], names)
            raise UsageError(
                f"{self.prog} does not know {' '.join(unknown):.200}",
                self.format_usage().strip(),
                f"{hint} All options:  {self.prog} --help".strip(),
            )
        return options, unknown


def declare(commands: "Commands", name: str, purpose: str, example: str, help: str = "") -> ExplainingParser:
    """A command with its ``--help``: its purpose as a sentence, and an example without the program's name.

    ``help`` is its line in the list of commands; without it, the purpose.
    """
    return commands.add_parser(
        name,
        help=help or purpose,
        description=purpose,
        epilog=f"Example:  radiogs-bench {example}",
        allow_abbrev=False,
    )


def names(text: str) -> list[str]:
    """A list separated by commas."""
    return [name for name in text.split(",") if name]


def effects(text: str) -> "Effects":
    """``all``, ``auto``, or a list of effects separated by commas; ``none`` is the empty list."""
    from radiogs_core.transport.plan import checked_effects

    if text in ("all", "auto"):
        return text
    return checked_effects(() if text == "none" else names(text))


def add_recipe(parser: argparse.ArgumentParser) -> None:
    """Declare ``--recipe``."""
    parser.add_argument(
        "--recipe", metavar="NAME",
        help="Take all settings from this recipe of the method: RadioGS has printed (the paper's values), released"
        " (the published code's) and recommended, its default.",
    )  # fmt: skip


def add_effects(parser: argparse.ArgumentParser, default: str | None = "all") -> None:
    """Add ``--effects``, for commands that simulate light."""
    parser.add_argument(
        "--effects", type=effects, default=default, metavar="all|auto|LIST",
        help="Simulate all effects, those that the scene needs (auto), or the ones in this list (default: all).",
    )  # fmt: skip


def setting(text: str) -> tuple[str, Any]:
    """FIELD=VALUE: a dotted name and a value, which is TOML (``0.01``, ``["a"]``) or a bare word (``auto``)."""
    import tomllib

    name, sign, written = text.partition("=")
    name, written = name.strip(), written.strip()
    if not sign or not all(part.isidentifier() for part in name.split(".")):
        raise argparse.ArgumentTypeError(f"'{text}' is not FIELD=VALUE, such as materials.rates.light=0.01")
    try:
        read = tomllib.loads(f"value = {written}")
    except (ValueError, RecursionError):
        if not BARE_WORD.fullmatch(written):
            raise argparse.ArgumentTypeError(f"'{written}' of {name} is neither TOML nor a single word") from None
        return name, written
    if read.keys() != {"value"}:
        raise argparse.ArgumentTypeError(f"'{written}' of {name} is more than one value")
    return name, read["value"]


def add_set(parser: argparse.ArgumentParser) -> None:
    """Add ``--set``, for commands that train."""
    parser.add_argument(
        "--set", dest="settings", action="append", type=setting, default=[], metavar="FIELD=VALUE",
        help="Set a field of the method's variant or budget, by its dotted name as `methods NAME` lists it, such as"
        " materials.rates.light=0.01. This option may be repeated.",
    )  # fmt: skip


def settings_from(options: argparse.Namespace) -> dict[str, Any]:
    """The fields that ``--set`` changes, by dotted names. Raises UsageError for one that is set twice."""
    names = [name for name, _ in options.settings]
    if "variant.effects" in names:
        names[names.index("variant.effects")] = "effects"
    if options.effects not in (None, "all"):
        names.append("effects")
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise UsageError(
            f"'{twice[0]}' is set twice", "", "Give every field once (--effects sets the field 'effects')."
        )
    return dict(options.settings)


def positive(text: str) -> int:
    """A whole number above zero."""
    if not text.isdecimal() or len(text) > LONGEST_COUNT or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number above zero")
    return int(text)


def views_kept(text: str) -> int:
    """A whole number, or ``all``."""
    if text == "all":
        return sys.maxsize
    if not text.isdecimal() or len(text) > LONGEST_COUNT:
        raise argparse.ArgumentTypeError(f"'{text}' is neither a whole number nor 'all'")
    return int(text)


def seeds(text: str) -> int:
    """A number of seeds, bounded because all cells of all seeds are listed before anything is run."""
    if positive(text) > MOST_SEEDS:
        raise argparse.ArgumentTypeError(f"'{text}' seeds: up to {MOST_SEEDS} are taken in one run")
    return positive(text)


def differences(text: str) -> dict[str, float]:
    """Sizes of differences by column, such as nvs/psnr=0.5,albedo/psnr=0.3."""
    found = {}
    for each in names(text):
        column, _, size = each.partition("=")
        try:
            found[column] = float(size)
        except ValueError:
            raise argparse.ArgumentTypeError(f"'{each}' is not COLUMN=SIZE, such as albedo/psnr=0.3") from None
        if not 0 < found[column] < math.inf:
            raise argparse.ArgumentTypeError(f"'{each}': a difference is positive and finite")
    return found


def pixels(text: str) -> int:
    """Number of pixels on each side of a picture."""
    if not SMALLEST_PICTURE <= positive(text) <= LARGEST_PICTURE:
        raise argparse.ArgumentTypeError(f"'{text}' is not between {SMALLEST_PICTURE} and {LARGEST_PICTURE} pixels")
    return positive(text)


def add_scene_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say where scenes are and how they are opened; ``scene_options`` reads the latter."""
    group = parser.add_argument_group("how scenes are opened")
    add_data(group)
    group.add_argument("--layout", help="Read the scene in this layout (default: recognised from its files).")
    sizes = group.add_mutually_exclusive_group()
    sizes.add_argument("--reduce", type=positive, metavar="N", help="Divide both sides of every image by N.")
    sizes.add_argument(
        "--long-side", type=positive, metavar="PIXELS",
        help="Downscale images to at most this many pixels on their longer side.",
    )  # fmt: skip
    group.add_argument(
        "--hold-out", type=positive, metavar="N", help="Keep every Nth view of photos for testing (default: 8)."
    )
    group.add_argument(
        "--mask-folder", type=Path, metavar="DIR", help="Read a mask for every photo, by the photo's name, from DIR."
    )
    group.add_argument(
        "--masks", choices=["object", "ignore"],
        help="Take black in masks for places where nothing is (object, the default), or leave such pixels out of"
        " training and metrics (ignore).",
    )  # fmt: skip


def scene_options(options: argparse.Namespace) -> "SceneOptions":
    """The values of the options of ``add_scene_options``. Raises UsageError."""
    from radiogs_datasets.options import SceneOptions, absolute

    return SceneOptions(
        options.layout,
        options.hold_out,
        absolute(options.mask_folder),
        options.reduce,
        options.long_side,
        options.masks,
    )  # fmt: skip


def suite_of(name_or_file: str) -> "Suite":
    """A suite from the package, or from a file."""
    if name_or_file.endswith(".toml"):
        from ..suites.registry import read_suite

        return read_suite(Path(name_or_file))
    from ..suites.registry import suite

    return suite(name_or_file)


def part_of(text: str) -> tuple[int, int]:
    """A part and the number of parts, such as 0/2."""
    number, _, count = text.partition("/")
    if not (number.isdecimal() and count.isdecimal() and int(number) < int(count)):
        raise argparse.ArgumentTypeError(f"'{text}' is not a part such as 0/2")
    return int(number), int(count)


def add_data(parser: argparse._ActionsContainer) -> None:
    """Add ``--data``, for commands that read scenes; ``main`` sets it."""
    parser.add_argument(
        "--data", type=Path, metavar="ROOT",
        help="Look for scenes in this folder of data sets (default: the variable RADIOGS_BENCH_DATA).",
    )  # fmt: skip


PRESETS_HELP = "Take the amount of work of this preset: smoke, tiny, small or paper (default: {})."


def add_device(
    parser: argparse._ActionsContainer, threads: str = "Use N CPU threads (default: as many as there are cores)."
) -> None:
    """Add ``--device`` and ``--threads``, for commands that compute; ``device.chosen_device`` reads them."""
    parser.add_argument(
        "--device", choices=["cpu", "cuda"], default="cpu", help="Compute on this device (default: cpu)."
    )
    parser.add_argument("--threads", type=positive, metavar="N", help=threads)


def add_verbose(parser: argparse.ArgumentParser) -> None:
    """Add ``--verbose``, which every command has."""
    parser.add_argument("--verbose", action="store_true", help="Print a log, and the tracebacks of errors.")
