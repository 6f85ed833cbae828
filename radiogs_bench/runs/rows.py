"""The rows of a run: its suite's rows with the requested methods, recipe and fields."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from radiogs_core.capabilities import OffersRecipes
from radiogs_core.contract import Method
from radiogs_core.errors import UsageError, unknown
from radiogs_core.plain_values import flat, value_at

from ..methods import Settings, budget_of, mark, method, require_recipe, settable, settings_of, variant_of
from ..suites.suite import Row, Suite
from .spec import RunSpec


def asked_of(suite: Suite, spec: RunSpec, preset: str) -> tuple[Suite, list[str]]:
    """The suite with a spec's changes of its rows, and remarks on unchanged rows. Raises UsageError."""
    remarks: list[str] = []
    if spec.methods:
        suite = of_methods(suite, spec.methods)
    if spec.rows:
        suite = with_rows(suite, spec.rows)
    if spec.recipe:
        suite, remarks = with_recipe(suite, spec.recipe)
    if spec.effects != "all":
        suite = with_effects(suite, spec.effects)
    if spec.settings:
        suite, kept = with_settings(suite, spec.settings, preset)
        remarks += kept
    return suite, remarks


def of_methods(suite: Suite, names: Sequence[str]) -> Suite:
    """The suite for these methods: their own rows in it, else one row each, or one row per choice of given parts.

    Differences are taken against the suite's reference row if it remains, else against the first row.
    """
    rows: list[Row] = []
    for name in names:
        found = method(name)
        own = [row for row in suite.rows if row.method in (name, found.name)]
        key = re.sub(r"[^\w.-]", "-", found.name)
        rows += own or _rungs(suite, name, key, found.title) or [Row(key, "", found.title, method=name)]
    keys = [row.key for row in rows]
    reference = suite.reference if suite.reference in keys else keys[0]
    return replace(suite, rows=tuple(rows), reference=reference)


def _rungs(suite: Suite, name: str, key: str, title: str) -> list[Row]:
    """A row of another method's full form for each of the suite's choices of given parts."""
    choices = {row.given: row for row in suite.rows if row.given is not None}
    return [
        Row(f"{key}-{row.key}", "", f"{title}, {row.text}", method=name, given=given) for given, row in choices.items()
    ]


def with_rows(suite: Suite, keys: Sequence[str]) -> Suite:
    """The suite with only these rows, in its order; reference row as in ``of_methods``. Raises UsageError."""
    own = [row.key for row in suite.rows]
    for key in keys:
        if key not in own:
            raise unknown("row", key, own, of=f"suite '{suite.name}'")
    rows = tuple(row for row in suite.rows if row.key in keys)
    reference = suite.reference if suite.reference in keys or suite.reference is None else rows[0].key
    return replace(suite, rows=rows, reference=reference)


def with_recipe(suite: Suite, name: str) -> tuple[Suite, list[str]]:
    """The suite with a recipe for rows without one, and remarks on rows not run by it. Raises UsageError."""
    refused: dict[str, UsageError] = {}
    for used in dict.fromkeys(row.method for row in suite.rows):
        try:
            require_recipe(method(used), name)
        except UsageError as error:
            refused[used] = error
    if all(row.method in refused for row in suite.rows):
        raise next(iter(refused.values()))
    misnamed = [error for each, error in refused.items() if isinstance(method(each), OffersRecipes)]
    if misnamed:
        raise misnamed[0]
    kept = [f"row '{row.key}' keeps its recipe, {row.recipe}" for row in suite.rows if row.recipe not in ("", name)]
    lacking = [f"rows of method '{each}' run as they are: it has no recipes" for each in refused]
    return replace(suite, recipe=name), [*kept, *lacking]


def recipe_of_row(suite: Suite, row: Row, used: Method) -> str:
    """The recipe of a row: its own, else the suite's if the row's method offers any; empty without recipes."""
    return row.recipe or (suite.recipe if isinstance(used, OffersRecipes) else "")


def with_effects(suite: Suite, effects: str | Sequence[str]) -> Suite:
    """The suite with effects set and marked in every row that sets none and whose method has these effects."""
    marked = effects if isinstance(effects, str) else "+".join(effects) or "none"

    def changed(row: Row) -> Row:
        variant = {**row.variant, "effects": effects}
        if "effects" in row.variant:
            return row
        try:
            variant_of(method(row.method), variant)
        except UsageError:
            return row
        latex = f"{row.latex} ({marked})" if row.latex else ""
        return replace(row, variant=variant, latex=latex, text=f"{row.text} (effects: {marked})")

    return replace(suite, rows=tuple(map(changed, suite.rows)))


def with_settings(suite: Suite, given: Mapping[str, Any], preset: str) -> tuple[Suite, list[str]]:
    """The suite with fields set in every row whose method has them, and remarks on the rows that differ.

    ``given`` has plain values by dotted names of fields of a variant or a budget (``methods.settings_of``). Labels name
    the fields that were set. A row keeps a variant's field that it sets itself, because the suite compares it. Raises
    UsageError for a name that no row's method has, and for a value that a method does not take.
    """
    methods = {name: method(name) for name in dict.fromkeys(row.method for row in suite.rows)}
    found = {name: settings_of(used, preset, given) for name, used in methods.items()}
    for name in given:
        if not any(_has(settings_of(used, preset, {name: given[name]})) for used in methods.values()):
            names = dict.fromkeys(each for used in methods.values() for each in settable(used, preset))
            raise unknown("field", name, names, "See the fields of each method:  radiogs-bench methods")
    for name, used in methods.items():
        variant_of(used, found[name].variant)
        budget_of(used, preset, found[name].budget)
    remarks: list[str] = []
    rows = tuple(_with_settings(row, found[row.method], preset, remarks) for row in suite.rows)
    lacking = [name for name, settings in found.items() if not _has(settings)]
    remarks += [f"rows of method '{name}' run as they are: it has none of the fields that are set" for name in lacking]
    return replace(suite, rows=rows), remarks


def _has(settings: Settings) -> bool:
    return bool(settings.variant or settings.budget)


def _with_settings(row: Row, settings: Settings, preset: str, remarks: list[str]) -> Row:
    """A row with fields set and marks on its label; adds to ``remarks`` the fields that the row keeps."""
    used, own = method(row.method), flat(row.variant)
    kept = {
        name
        for name in settings.variant
        if any(name == each or name.startswith(f"{each}.") or each.startswith(f"{name}.") for each in own)
    }
    remarks += [f"row '{row.key}' sets {name} itself and keeps its value" for name in sorted(kept)]
    changes = {name: value for name, value in settings.variant.items() if name not in kept}
    try:
        made = variant_of(used, {**row.variant, **changes})
    except UsageError as refused:
        remarks.append(f"row '{row.key}' keeps its variant: {refused.what}")
        made, changes = variant_of(used, row.variant), {}
    numbers = {**settings.budget, **row.numbers}
    budget = budget_of(used, preset, numbers)
    marks = [
        *(mark(name, value_at(made, name)) for name in changes),
        *(mark(name, value_at(budget, name)) for name in settings.budget),
    ]
    if not marks:
        return row
    text = f"{row.text} ({', '.join(sorted(marks))})"
    return replace(row, variant={**row.variant, **changes}, numbers=numbers, latex="", text=text)
