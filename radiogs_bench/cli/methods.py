"""``radiogs-bench methods``: installed methods, with their presets and the fields of their variants."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from cyclopts import App

from radiogs_core.errors import ExplainedError, UsageError

from .options import ON_CPU, OPTIONS, Computing, Json, MethodName, PresetName, SceneName
from .reporter import complain, say, say_whole, show

methods = App(name="methods", group_parameters=OPTIONS)


@methods.default
def describe_methods(method: MethodName | None = None, /, *, recipes: bool = False, as_json: Json = False) -> int:
    """List the installed methods, or the presets and fields of one, or check that one keeps its contract.

    Example:  radiogs-bench methods radiogs

    :param method: Show every preset and field of this method, or TOML file.
    :param recipes: With a name, print every value of the method's recipes with its source, as Markdown.
    :param as_json: Print one JSON object a line.
    """
    if recipes:
        return _show_recipes(method)
    if method is None and not as_json:
        return _list_all()
    from ..errors import explain, worst_exit_code
    from ..installed_methods import method_names
    from ..methods import describe
    from ..methods import method as installed

    described: list[dict[str, Any]] = []
    broken: list[ExplainedError] = []
    for each in method_names() if method is None else [method]:
        try:
            described.append(describe(installed(each)))
        except ExplainedError as error:  # one broken package must not hide the others
            if method is not None:
                raise
            broken.append(error)
    if as_json:
        for about in described:
            say_whole(json.dumps(about, allow_nan=False))
    else:
        _show_one(described[0])
    for failure in broken:
        complain(explain(failure))
    return worst_exit_code(broken)


@methods.command
def check(
    method: MethodName,
    /,
    *,
    scene: SceneName = "convex",
    preset: PresetName = "smoke",
    as_json: Json = False,
    on: Computing = ON_CPU,
) -> int:
    """Train a method, and check that it keeps its contract; the exit code is 1 if not.

    Example:  radiogs-bench methods check my-method --scene corner

    :param method: Check this method, or the one in a TOML file.
    :param scene: Train on this scene, by name or folder.
    :param preset: Train at this preset.
    :param as_json: Print one JSON object a line.
    """
    from tempfile import TemporaryDirectory

    from radiogs_core.errors import unknown
    from radiogs_datasets import load_scene

    from ..methods import method as installed
    from ..runs.contract_check import check_method

    used, place = installed(method), on.use()
    if preset not in used.presets:
        raise unknown("preset", preset, used.presets, of=used.name)
    opened, broken = load_scene(scene), 0
    with TemporaryDirectory() as folder:
        for found in check_method(used, opened, preset, place, Path(folder), complain):
            say(json.dumps(asdict(found)) if as_json else f"{found.verdict:5}  {found.what}")
            if found.remedy and not as_json:
                say(f"{'':5}  {found.remedy}")
            broken += found.verdict == "fails"
    if not as_json:
        say(f"{used.name}: {'nothing is broken' if not broken else f'{broken} of its rules are broken'}")
    return int(broken > 0)


def _show_recipes(name: str | None) -> int:
    from radiogs_core.capabilities import OffersRecipes

    from ..methods import method

    if name is None:
        raise UsageError("recipes of which method?", "", "Name one:  radiogs-bench methods radiogs --recipes")
    used = method(name)
    if not isinstance(used, OffersRecipes):
        raise UsageError(f"{used.name} has no recipes", "Its settings are its defaults.", "Leave --recipes out.")
    say_whole(used.recipe_table().rstrip("\n"))
    return 0


def _list_all() -> int:
    """Print the name of every method and the package that offers it; no method is loaded."""
    from ..installed_methods import method_names, origin

    names = method_names()
    width = max(map(len, names))
    for name in names:
        say(f"{name:{width}}  {origin(name)}")
    say("presets, stages and fields of one:  radiogs-bench methods NAME;  to add yours: docs/your_method.md")
    return 0


def _show_one(described: Mapping[str, Any]) -> None:
    from rich.table import Table

    from radiogs_core.plain_values import flat

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
