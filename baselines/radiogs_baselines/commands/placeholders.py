"""Placeholders in the texts of a method's file: their names, the fields that allow each, and their replacement."""

import string
from collections.abc import Mapping, Sequence

from radiogs_core.errors import UsageError, did_you_mean

EVERYWHERE: Mapping[str, str] = {
    "code": "the folder of the public code",
    "python": "the interpreter of the public code's own environment",
    "scene": "the folder of the scene",
    "scene_name": "the scene's name",
    "output": "the folder that the code writes its results into",
    "lights": "the folder of the scene's environment maps, a file a light",
    "seed": "the seed of the run",
    "threads": "how many threads a command may use",
    "device": "the device of the run, such as cpu or cuda",
    "iterations": "the preset's iterations of the first stage",
    "further": "the preset's iterations of the later stages",
    "total": "the sum of iterations and further",
}
"""Placeholders that are allowed in all fields but results, with their meanings."""

IN_RESULTS: Mapping[str, str] = {name: what for name, what in EVERYWHERE.items() if name not in ("code", "python")}
"""Placeholders that are allowed in paths of results, which are read on machines without the code."""

ONE_LIGHT: Mapping[str, str] = {
    "light": "the name of the light to relight under",
    "light_file": "that light's file: latitude-longitude, Z up, centre column towards +X",
}
"""Placeholders of a relighting command that runs once for each light."""

LISTS: Mapping[str, str] = {
    "arguments": "further arguments of the variant",
    "resume": "the command's arguments for continuing an interrupted run",
}
"""Placeholders for a list of arguments; such a placeholder must be a whole argument."""

ITERATIONS = frozenset({"iterations", "further", "total"})
"""Placeholders whose values are the iterations of a preset."""


def placeholders(text: str) -> list[str]:
    """Names of the placeholders in a text, in order; ``{{`` is a brace. Raises ValueError for an unmatched brace."""
    found = []
    for _, name, form, conversion in string.Formatter().parse(text):
        if name is None:
            continue
        if form or conversion:
            raise ValueError(f"'{{{name}' has a format, but a placeholder is only a name between braces")
        found.append(name)
    return found


def check(text: str, known: Mapping[str, str], where: str) -> None:
    """Raise UsageError, which names the field (``where``), for a placeholder not in ``known`` and for other braces."""
    try:
        names = placeholders(text)
    except ValueError as error:
        raise UsageError(
            f"{where}: '{text}' cannot be read: {error}", "Braces enclose placeholders.", "Write {{ for a brace."
        ) from error
    for name in names:
        if name in known:
            continue
        why = "It has no value in this field."
        if name in ONE_LIGHT:
            why = "It is allowed only in [relight] without all_lights."
        elif name in LISTS:
            why = "It stands for several arguments, so it has to be an argument of its own in a list of arguments."
        raise UsageError(
            f"{where}: there is no placeholder '{{{name}}}'",
            f"{why} {did_you_mean(f'{{{name}}}', [f'{{{each}}}' for each in known])}".strip(),
            f"Known here: {', '.join(f'{{{each}}}' for each in known)}.",
        )


def filled_list(
    texts: Sequence[str], values: Mapping[str, str], lists: Mapping[str, Sequence[str]] | None = None
) -> tuple[str, ...]:
    """The texts with placeholders replaced; a text that is the placeholder of a list is replaced by the list.

    A text that ``check`` has passed has plain names alone, so that it is a format of ``values``.
    """
    lists = lists or {}
    result: list[str] = []
    for text in texts:
        name = text[1:-1] if text.startswith("{") and text.endswith("}") else ""
        result += lists[name] if name in lists else [text.format_map(values)]
    return tuple(result)
