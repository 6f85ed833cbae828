"""Names of installed methods, found by their entry points, this project's methods included.

A package offers a method by an entry point of the group ``radiogs_bench.methods`` whose object is a
``radiogs_core.contract.Method`` (docs/your_method.md). Listing names is fast, because nothing here imports PyTorch.
"""

from collections.abc import Mapping
from functools import cache
from importlib import resources
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING

from radiogs_core.errors import UsageError

if TYPE_CHECKING:
    from radiogs_core.contract import Method

GROUP = "radiogs_bench.methods"

substitutes: dict[str, "Method"] = {}
"""Methods by name that a Python program gives to the harness; they take precedence over installed ones."""


def method_names() -> tuple[str, ...]:
    """Names of all methods that are installed or given, sorted."""
    return tuple(sorted({*offered_methods(), *recipes(), *substitutes}))


def recipes() -> Mapping[str, Path]:
    """Files of commands for published codes, by name; they come with the package, the codes do not."""
    folder = Path(str(resources.files("radiogs_baselines"))) / "commands" / "recipes"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def origin(name: str) -> str:
    """The package that offers a method."""
    point = offered_methods().get(name)
    if name in recipes():
        return "a recipe for a published code"
    return "this program" if point is None or point.dist is None else f"{point.dist.name} {point.dist.version}"


@cache
def offered_methods() -> Mapping[str, EntryPoint]:
    """The entry points of installed methods by name. Raises UsageError for two of one name."""
    found: dict[str, EntryPoint] = {}
    for point in entry_points(group=GROUP):
        if point.name in found and point.value != found[point.name].value:
            raise UsageError(
                f"two packages offer a method '{point.name}'",
                f"{found[point.name].value} and {point.value}.",
                "Uninstall one of them, or rename its entry point.",
            )
        found[point.name] = point
    return found
