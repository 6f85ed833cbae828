"""The methods that are installed (``method_names``), loaded and checked, with their variants and budgets.

A method may also be a TOML file of commands (docs/your_method.md).
"""

import hashlib
import json
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, fields, is_dataclass, replace
from functools import cache
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from radiogs_core.capabilities import PARTS, OffersRecipes, TakesGiven
from radiogs_core.contract import LARGEST_COUNT, Method, Run
from radiogs_core.errors import UsageError, unknown
from radiogs_core.plain_values import flat, leaf_names, to_plain, value_at, with_values
from radiogs_datasets.bounded_reading import read_bytes

from .installed_methods import method_names, offered_methods, origin, recipes, substitutes
from .method_calls import calling, lacking, stops_at_once
from .process_state import ours, set_apart
from .trusted_methods import SUFFIX, method_of_file, read_file, trusted_files, trusting

DEFAULT = "radiogs"
"""The method that suites and commands mean when they name none."""

OURS = "radiogs-bench"
"""Name of the distribution whose methods do not change the process's state."""


def method(name: str) -> Method:
    """A method by its name, or from a trusted TOML file of commands. Raises UsageError for an unusable one."""
    if name in substitutes:
        return substitutes[name]
    if name.endswith(SUFFIX):
        return method_of_file(name)
    offered = offered_methods()
    if name not in offered and name in recipes():
        return read_file(recipes()[name])
    if name not in offered:
        raise unknown("method", name, method_names(), "See them all:  radiogs-bench methods")
    return _loaded(offered[name])


def variant_of(of: Method, given: Mapping[str, Any]) -> Any:
    """A variant of a method: its full form with the given fields changed. Raises UsageError for an unknown field.

    Values are plain, as a suite's file or a stored result has them: lists for tuples. Fields of nested settings are
    given by dotted names or by tables.
    """
    return with_values(of.variant(), given, f"variant of {of.name}")


def variant_by_recipe(of: Method, recipe: str, layout: str, scene: str, given: Mapping[str, Any]) -> Any:
    """A method's variant by one of its recipes (without a recipe: its full form), with the given fields changed.

    ``layout`` and ``scene``: layout and name of the scene, because recipes may differ between scenes. Raises UsageError
    for a recipe that the method does not offer, and as ``variant_of`` does.
    """
    if not recipe:
        return variant_of(of, given)
    require_recipe(of, recipe)
    assert isinstance(of, OffersRecipes)
    with calling(of.name, "recipe_values()"):
        values = of.recipe_values(recipe, layout, scene)
    return variant_of(of, {**flat(values), **flat(given)})


def splat_fields(of: Method, file: Path) -> dict[str, str]:
    """The fields of a method's variant by which its training starts from a file of splats: its path and its SHA-256.

    Raises UsageError for a method that does not start from splats, DataError for a file that cannot be read.
    """
    if "geometry.start.splat" not in leaf_names(of.variant()):
        raise UsageError(
            f"{of.name} does not start from splats",
            "Methods on surfels do: their variant has the field geometry.start.splat.",
            "Leave --start out, or choose another --method:  radiogs-bench methods",
        )
    digest = hashlib.sha256(read_bytes(file)).hexdigest()
    return {"geometry.start.splat": str(file.absolute()), "geometry.start.splat_sha256": digest}


def require_recipe(of: Method, recipe: str) -> None:
    """Raise UsageError unless the method offers a recipe of that name."""
    if not isinstance(of, OffersRecipes):
        raise UsageError(
            f"{of.name} has no recipes, and none called '{recipe}'",
            "A recipe is a named set of all settings of a method; this one has its defaults alone.",
            "Leave --recipe out.",
        )
    if recipe not in of.recipes:
        raise unknown("recipe", recipe, of.recipes, of=of.name)


def nearest_recipe(
    of: Method, variant: Mapping[str, Any], layout: str, scene: str, given: Mapping[str, Any]
) -> tuple[str, dict[str, Any]]:
    """The recipe, with the given fields changed, from which a stored variant differs in the fewest fields.

    ``variant``: plain values. Returns the recipe's name and the fields that differ, by dotted names, with the variant's
    values. The name is empty for a method without recipes, which is compared with its full form.
    """
    values = flat(variant)

    def differing(recipe: str) -> dict[str, Any]:
        own = flat(to_plain(variant_by_recipe(of, recipe, layout, scene, given)))
        return {name: value for name, value in values.items() if name in own and own[name] != value}

    names: Sequence[str] = tuple(of.recipes) if isinstance(of, OffersRecipes) else ("",)
    return min(((name, differing(name)) for name in names), key=lambda each: len(each[1]))


def default_recipe(of: Method) -> str:
    """The recipe with the values of a method's defaults; empty if it has none."""
    name, changed = nearest_recipe(of, to_plain(of.variant()), "", "", {})
    return "" if changed else name


@runtime_checkable
class ShortensRecipes(Protocol):
    """A method whose published recipes change with the length of training."""

    def recipe_at(self, name: str, variant: Any, budget: Any) -> str:
        """The name under which tables print a recipe: if training is shortened, with a mark and the factors."""


def recipe_in_tables(of: Method, recipe: str, given: Mapping[str, Any], budget: Any) -> str:
    """The name under which tables print a method's recipe with the given fields changed, under a budget."""
    if not (recipe and isinstance(of, ShortensRecipes)):
        return recipe
    with calling(of.name, "recipe_at()"):
        return of.recipe_at(recipe, variant_by_recipe(of, recipe, "", "", given), budget)


def why_not_given(of: Method, parts: Sequence[str]) -> str:
    """Why a method cannot be given these parts of the truth, in words; empty if it can."""
    if not parts:
        return ""
    if not isinstance(of, TakesGiven):
        return f"{of.name} takes no part of the truth as given"
    lacks = [part for part in parts if part not in of.given_parts]
    return f"{of.name} does not take {' and '.join(lacks)} as given" if lacks else ""


def with_given(of: Method, variant: Any, parts: Sequence[str]) -> Any:
    """The method's variant to which these parts of the truth are given. Raises UsageError where it cannot take them."""
    if not parts:
        return variant
    refusal = why_not_given(of, parts)
    if refusal or not isinstance(of, TakesGiven):
        raise UsageError(refusal, f"Parts: {', '.join(PARTS)}.", "How a method offers it: docs/your_method.md")
    with calling(of.name, "with_given()"):
        return of.with_given(variant, tuple(parts))


def budget_of(of: Method, preset: str, given: Mapping[str, Any] | None = None) -> Any:
    """A method's budget by the name of its preset, with ``given`` numbers in place of the preset's.

    The budget's name then lists the changed numbers: ``tiny, inverse_iterations = 300``. ``given`` has plain values by
    dotted names or in nested tables. Raises UsageError for an unknown preset or field, and for an invalid amount of
    work: whole numbers range from 1 to 2^31 - 1, others are not negative.
    """
    if preset not in of.presets:
        raise unknown("preset", preset, of.presets, of=of.name)
    budget, values = of.presets[preset], flat(given or {})
    if "name" in values:
        raise UsageError("the name of a budget cannot be set", "It says which preset and which changes it is made of.")
    changed = with_values(budget, given or {}, f"budget of {of.name}")
    for name in values:
        number = value_at(changed, name)
        least, most = (1, LARGEST_COUNT) if type(number) is int else (0, float("inf"))
        if isinstance(number, int | float) and not least <= number <= most:
            raise UsageError(
                f"budget of {of.name}: {name}: {number} is not between {least} and {most}",
                remedy=f"See its presets:  radiogs-bench methods {of.name}",
            )
    marks = [
        mark(name, value_at(changed, name)) for name in values if value_at(changed, name) != value_at(budget, name)
    ]
    return replace(changed, name=", ".join([preset, *sorted(marks)]))


def mark(name: str, value: Any) -> str:
    """A field with its new value, as labels print it: ``inverse_iterations = 300``."""
    return f"{name} = {value if isinstance(value, str) and value.isprintable() else json.dumps(value)}"


def marks_of(settings: Mapping[str, Any]) -> str:
    """Fields with their new values, ordered by name; empty if none was set."""
    return ", ".join(sorted(mark(name, value) for name, value in settings.items()))


@dataclass(frozen=True)
class Settings:
    """Values for fields of one method, by dotted names."""

    variant: Mapping[str, Any]
    budget: Mapping[str, Any]


def settings_of(of: Method, preset: str, given: Mapping[str, Any]) -> Settings:
    """The ``given`` values for fields of a method's variant, and for fields of its budget.

    ``variant.NAME`` and ``budget.NAME`` are full names. Other names are left out. Raises UsageError for a name that is
    a field of both.
    """
    values: dict[str, dict[str, Any]] = {"variant": {}, "budget": {}}
    names = _names_by_owner(of, preset)
    for name, value in given.items():
        owner, _, rest = name.partition(".")
        found = (
            [(owner, rest)] if rest in names.get(owner, ()) else [(each, name) for each in names if name in names[each]]
        )
        if len(found) > 1:
            raise UsageError(
                f"both the variant and the budget of {of.name} have a field '{name}'",
                "It is not clear which of them is meant.",
                f"Write variant.{name} or budget.{name}.",
            )
        for owner, field in found:
            if field in values[owner]:
                raise UsageError(
                    f"'{field}' of the {owner} of {of.name} is set twice",
                    f"'{name}' and '{field}' are the same field.",
                    "Give every field once.",
                )
            values[owner][field] = value
    return Settings(**values)


def settable(of: Method, preset: str) -> list[str]:
    """Dotted names of all fields of a method's variant and budget."""
    return [name for names in _names_by_owner(of, preset).values() for name in names]


def _names_by_owner(of: Method, preset: str) -> dict[str, list[str]]:
    budget = [name for name in leaf_names(budget_of(of, preset)) if name != "name"]
    return {"variant": leaf_names(of.variant()), "budget": budget}


def settings_for(of: Method, preset: str, given: Mapping[str, Any]) -> Settings:
    """Values for the method's variant and budget. Raises UsageError for a ``given`` name that is not a field of it."""
    for name in given:
        found = settings_of(of, preset, {name: given[name]})
        if not (found.variant or found.budget):
            raise unknown("field", name, settable(of, preset), "See its fields:  radiogs-bench methods", of=of.name)
    return settings_of(of, preset, given)


def settings_as_toml(of: Method, run: Run) -> tuple[str, int]:
    """A run's variant and budget as TOML, and the number of the variant's fields that differ from the published recipe.

    A comment beside each differing field has the published value. ``settings_for`` takes the tables, flat. Fields with
    the value None are left out, because TOML cannot hold it.
    """
    recipe = of.published_recipe if isinstance(of, OffersRecipes) else ""
    published = flat(to_plain(variant_by_recipe(of, recipe, run.scene.layout, run.scene.name, {})))
    values, lines = flat(to_plain(run.variant)), [f"# {of.name}, scene {json.dumps(run.scene.name)}", "", "[variant]"]
    unlike = {name for name, value in values.items() if value != published.get(name)}
    for name, value in values.items():
        remark = f"  # published: {json.dumps(published.get(name))}" if name in unlike else ""
        lines += [] if value is None else [f"{name} = {json.dumps(value)}{remark}"]
    budget = {name: value for name, value in flat(to_plain(run.budget)).items() if name != "name" and value is not None}
    lines += ["", "[budget]", *(f"{name} = {json.dumps(value)}" for name, value in budget.items())]
    return "\n".join([*lines, ""]), len(unlike)


class FoundMethods:
    """Finds methods as ``method`` does, and keeps them; pickles without them, because a method may not be picklable.

    ``trusted``: methods' files that the run's command line names (default: the files that this process trusts).
    """

    def __init__(self, trusted: Sequence[str] | None = None) -> None:
        self._found: dict[str, Method] = {}
        self._trusted = trusted_files() if trusted is None else tuple(trusted)

    def __call__(self, name: str) -> Method:
        """The method of that name. Raises UsageError as ``method`` does."""
        if name not in self._found:
            with trusting(self._trusted):
                self._found[name] = method(name)
        return self._found[name]

    def __reduce__(self) -> tuple[type["FoundMethods"], tuple[tuple[str, ...]]]:
        return FoundMethods, (self._trusted,)


def describe(of: Method) -> dict[str, Any]:
    """A method for ``radiogs-bench methods``: presets with their numbers, fields of the variant with their defaults."""
    full = of.variant()
    with calling(of.name, "stages()"):
        stages = {
            name: [{"name": stage.name, "steps": stage.steps} for stage in of.stages(full, budget)]
            for name, budget in of.presets.items()
        }
    return {
        "name": of.name,
        "title": of.title,
        "origin": origin(of.name),
        "presets": {name: asdict(budget) for name, budget in of.presets.items()},
        "variant": asdict(full),
        "stages": stages,
    }


@cache
def _loaded(point: EntryPoint) -> Method:
    if point.dist is not None and point.dist.name == OURS:
        ours.add(point.name)
    try:
        with set_apart(point.name, "its import", loading=True):
            loaded = point.load()
    except BaseException as error:  # whatever is wrong with a package is told with its name
        if stops_at_once(error):
            raise
        places = [each for each in traceback.extract_tb(error.__traceback__) if not each.filename.startswith("<frozen")]
        raise UsageError(
            f"the method '{point.name}' cannot be loaded",
            f"{point.value}: {type(error).__name__}: {error}, at {places[-1].filename}, line {places[-1].lineno}.",
            "Mend or uninstall its package.",
        ) from error
    wrong = _wrong(loaded, point.name)
    if wrong:
        raise UsageError(
            f"the method '{point.name}' is not what a method is",
            f"{point.value}: {wrong}.",
            "What a method is: docs/your_method.md",
        )
    checked: Method = loaded
    return checked


SMOKE = "smoke"
"""The preset that every method must offer: kernels are compiled with it."""


def _wrong(loaded: Any, name: str) -> str:
    """Why an object is not a valid method of an entry point; empty if it is valid."""
    if isinstance(loaded, type):
        return f"it is the class {loaded.__name__} and has to be an instance of it"
    missing = lacking(loaded, Method)
    if missing:
        return f"it lacks {', '.join(missing)}"
    if loaded.name != name:
        return f"its name is '{loaded.name}' and the key of its entry point '{name}'; they have to be the same"
    if not isinstance(loaded.variant, type) or not is_dataclass(loaded.variant):
        return "its variant has to be a dataclass, the class itself"
    bare = [each for each in fields(loaded.variant) if each.default is MISSING and each.default_factory is MISSING]
    if bare:
        names = ", ".join(each.name for each in bare)
        return f"its variant has no default for {names}; the defaults are the full method"
    if SMOKE not in loaded.presets:
        return f"its presets are {', '.join(loaded.presets)}, and '{SMOKE}' has to be among them"
    for key, budget in loaded.presets.items():
        if not is_dataclass(budget) or getattr(budget, "name", None) != key:
            return f"its preset '{key}' has to be an instance of a dataclass whose name is '{key}'"
    return ""
