"""``radiogs-bench methods``: installed methods, with their presets and the fields of their variants."""

import argparse
import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radiogs_core.errors import ExplainedError, UsageError

from .device import chosen_device
from .options import add_device, add_verbose, declare

if TYPE_CHECKING:
    from .options import Commands


CHECK = "check"
"""The word before the name of a method that is to be checked."""

SCENE = "convex"
"""The scene that it is checked on by default: the smallest one."""


def add_to(commands: "Commands") -> None:
    """Declare the command."""
    parser = declare(
        commands, "methods",
        "List the installed methods, or the presets and fields of one, or check that one keeps its contract.",
        "methods check my-method --scene corner",
    )  # fmt: skip
    parser.set_defaults(command=methods)
    parser.add_argument(
        "name", nargs="*", metavar="[check] NAME",
        help="Show every preset and field of this method, or TOML file; after `check`, train it and say whether it does"
        " all that a method has to (exit code 1 if not).",
    )  # fmt: skip
    parser.add_argument(
        "--recipes", action="store_true",
        help="With a name, print every value of the method's recipes with its source, as Markdown.",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="Print one JSON object a line.")
    group = parser.add_argument_group("check")
    group.add_argument("--scene", metavar="PATH", help=f"Train on this scene, by name or folder (default: {SCENE}).")
    group.add_argument("--preset", help="Train at this preset (default: smoke).")
    add_device(group)
    add_verbose(parser)


def methods(options: argparse.Namespace) -> int:
    """List the names of all methods, or print everything about one, or about all of them as JSON; or check one."""
    checks, name = named(options)
    if checks:
        return check(name, options)
    if options.recipes:
        return _show_recipes(name)
    if not (name or options.json):
        return _list_all()
    from ..errors import explain, worst_exit_code
    from ..installed_methods import method_names
    from ..methods import describe, method
    from .reporter import complain, say_whole

    described: list[dict[str, Any]] = []
    broken: list[ExplainedError] = []
    for each in [name] if name else method_names():
        try:
            described.append(describe(method(each)))
        except ExplainedError as error:  # one broken package must not hide the others
            if name:
                raise
            broken.append(error)
    if options.json:
        for about in described:
            say_whole(json.dumps(about, allow_nan=False))
    else:
        _show_one(described[0])
    for failure in broken:
        complain(explain(failure))
    return worst_exit_code(broken)


def named(options: argparse.Namespace) -> tuple[bool, str]:
    """Whether to check a method, and its name, empty for all. Raises UsageError for what does not go together."""
    checks, names = options.name[:1] == [CHECK], [*options.name]
    if checks:
        names = names[1:]
        if not names:
            raise UsageError("check which method?", "", f"Name one:  radiogs-bench methods {CHECK} radiogs")
        if options.recipes:
            raise UsageError("--recipes does not go with check", "", "Leave one of them out.")
    elif options.scene or options.preset:
        raise UsageError(
            "--scene and --preset go with check alone", "", f"radiogs-bench methods {CHECK} NAME --scene PATH"
        )
    if len(names) > 1:
        raise UsageError(f"{len(names)} methods are named: {', '.join(names)}", "", "Name one, or none for a list.")
    return checks, "".join(names)


def check(name: str, options: argparse.Namespace) -> int:
    """Check that a method keeps its contract; prints a line for each rule. Returns 1 if one is broken."""
    from tempfile import TemporaryDirectory

    from radiogs_core.errors import unknown
    from radiogs_datasets import load_scene

    from ..methods import method
    from ..runs.contract_check import check_method
    from .reporter import complain, say

    used, device, preset = method(name), chosen_device(options), options.preset or "smoke"
    if preset not in used.presets:
        raise unknown("preset", preset, used.presets, of=used.name)
    scene = load_scene(options.scene or SCENE)
    broken = 0
    with TemporaryDirectory() as folder:
        for found in check_method(used, scene, preset, device, Path(folder), complain):
            say(json.dumps(asdict(found)) if options.json else f"{found.verdict:5}  {found.what}")
            if found.remedy and not options.json:
                say(f"{'':5}  {found.remedy}")
            broken += found.verdict == "fails"
    if not options.json:
        say(f"{used.name}: {'nothing is broken' if not broken else f'{broken} of its rules are broken'}")
    return int(broken > 0)


def _show_recipes(name: str) -> int:
    from radiogs_core.capabilities import OffersRecipes

    from ..methods import method
    from .reporter import say_whole

    if not name:
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
