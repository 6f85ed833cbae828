"""Placeholders in the arguments of a command: which there are, where each may stand, and what they become."""

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
    "further": "the preset's iterations of what follows",
    "total": "iterations and further together",
}

IN_RESULTS: Mapping[str, str] = {name: what for name, what in EVERYWHERE.items() if name not in ("code", "python")}
"""In names of results: they are read where the code need not be."""

ONE_LIGHT: Mapping[str, str] = {
    "light": "the name of the light to relight under",
    "light_file": "that light's file: latitude-longitude, Z up, centre column towards +X",
}
"""Only where a command relights under one light."""

LISTS: Mapping[str, str] = {
    "arguments": "further arguments of the variant",
    "resume": "the command's arguments for going on with a run that was cut short",
}
"""Stand for any number of arguments, and so for an argument of their own."""

ITERATIONS = frozenset({"iterations", "further", "total"})


def placeholders(text: str) -> list[str]:
    """Names of the placeholders in a text, in order; ``{{`` is a brace. Raises ValueError for a lone brace."""
    found = []
    for _, name, form, conversion in string.Formatter().parse(text):
        if name is None:
            continue
        if form or conversion:
            raise ValueError(f"'{{{name}' is followed by a format: a placeholder is a name between braces")
        found.append(name)
    return found


def check(text: str, known: Mapping[str, str], where: str) -> None:
    """Raise UsageError for a placeholder that is not known there, or braces that are none."""
    try:
        names = placeholders(text)
    except ValueError as error:
        raise UsageError(
            f"{where}: '{text}' cannot be read: {error}", "Braces stand around placeholders.", "Write {{ for a brace."
        ) from error
    for name in names:
        if name in known:
            continue
        why = "It stands for nothing here."
        if name in ONE_LIGHT:
            why = "A light is known to a [relight] without all_lights alone."
        elif name in LISTS:
            why = "It stands for several arguments: it is an argument of its own, of a command that has any."
        raise UsageError(
            f"{where}: there is no placeholder '{{{name}}}'",
            f"{why} {did_you_mean(f'{{{name}}}', [f'{{{each}}}' for each in known])}".strip(),
            f"Known here: {', '.join(f'{{{each}}}' for each in known)}.",
        )


def filled(text: str, values: Mapping[str, str]) -> str:
    """The text with its placeholders replaced; checked texts have no others."""
    parts = []
    for literal, name, _, _ in string.Formatter().parse(text):
        parts.append(literal)
        if name is not None:
            parts.append(values[name])
    return "".join(parts)


def filled_list(
    texts: Sequence[str], values: Mapping[str, str], lists: Mapping[str, Sequence[str]] | None = None
) -> tuple[str, ...]:
    """Every text filled; one that is the name of a list becomes the list's texts, as they are."""
    lists = lists or {}
    result: list[str] = []
    for text in texts:
        name = text[1:-1] if text.startswith("{") and text.endswith("}") else ""
        result += lists[name] if name in lists else [filled(text, values)]
    return tuple(result)
