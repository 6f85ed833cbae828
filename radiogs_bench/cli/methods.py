"""``radiogs-bench methods``: installed methods, with their presets and the fields of their variants."""

import argparse
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from radiogs_core.errors import ExplainedError

from .options import add_verbose, declare

if TYPE_CHECKING:
    from .options import Commands


def add_to(commands: "Commands") -> None:
    """Declare the command."""
    parser = declare(
        commands, "methods", "List the installed methods, or the presets and fields of one.", "methods radiogs"
    )
    parser.set_defaults(command=methods)
    parser.add_argument(
        "name", nargs="?", metavar="NAME", help="Show every preset and field of this method, or TOML file."
    )
    parser.add_argument(
        "--recipes", action="store_true",
        help="With a name, print every value of the method's recipes with its source, as Markdown.",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="Print one JSON object a line.")
    add_verbose(parser)


def methods(options: argparse.Namespace) -> int:
    """List the names of all methods, or print everything about one, or about all of them as JSON."""
    if options.recipes:
        return _show_recipes(options.name)
    if not (options.name or options.json):
        return _list_all()
    from ..errors import explain, worst_exit_code
    from ..installed_methods import method_names
    from ..methods import describe, method
    from .reporter import complain, say_whole

    described: list[dict[str, Any]] = []
    broken: list[ExplainedError] = []
    for name in [options.name] if options.name else method_names():
        try:
            described.append(describe(method(name)))
        except ExplainedError as error:  # one broken package must not hide the others
            if options.name:
                raise
            broken.append(error)
    if options.json:
        for each in described:
            say_whole(json.dumps(each, allow_nan=False))
    else:
        _show_one(described[0])
    for failure in broken:
        complain(explain(failure))
    return worst_exit_code(broken)


def _show_recipes(name: str | None) -> int:
    from radiogs_core.capabilities import OffersRecipes
    from radiogs_core.errors import UsageError

    from ..methods import method
    from .reporter import say_whole

    if name is None:
        raise UsageError("recipes of which method?", "", "Name one:  radiogs-bench methods radiogs --recipes")
    used = method(name)
    if not isinstance(used, OffersRecipes):
        raise UsageError(f"{used.name} has no recipes", "Its settings are its defaults.", "Leave --recipes out.")
    say_whole(used.recipe_table().rstrip("\n"))
    return 0


def _list_all() -> int:
    """Print what every method is called and which package offers it; none of them is loaded."""
    from ..installed_methods import method_names, origin
    from .reporter import say

    names = method_names()
    width = max(map(len, names))
    for name in names:
        say(f"{name:{width}}  {origin(name)}")
    say("presets, stages and fields of one:  radiogs-bench methods NAME;  to add yours: docs/your_own_method.md")
    return 0


def _show_one(described: Mapping[str, Any]) -> None:
    from rich.table import Table

    from radiogs_core.plain_values import flat

    from .reporter import say, show

    say(f"{described['name']}: {described['title']}, from {described['origin']}")
    presets = {name: flat(budget) for name, budget in described["presets"].items()}
    numbers = Table("budget", *presets, title="presets")
    for name in next(iter(presets.values())):
        if name != "name":
            numbers.add_row(name, *(f"{preset[name]}" for preset in presets.values()))
    for preset in (each for each in presets if each in described["stages"]):
        steps = " + ".join(f"{stage['steps']}" for stage in described["stages"][preset])
        say(f"preset {preset}: {steps} steps")
    show(numbers)
    fields = Table("field", "default", title="variant: fields that rows of a suite and --set may change")
    for name, value in flat(described["variant"]).items():
        fields.add_row(name, json.dumps(value))
    show(fields)
