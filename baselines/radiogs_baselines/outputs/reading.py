"""Which files of a folder are a prediction of which map of which view."""

from collections.abc import Iterable
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path

from radiogs.errors import DataError, UsageError
from radiogs.scene import Scene, View

from .codes import CODES
from .files import Found, find, resolved, spellings
from .predictions import Predictions, relightable
from .rules import Rule


def likely_codes(folder: Path) -> list[str]:
    """Codes that the folder bears a mark of, without those whose marks another of them explains."""
    marked = [name for name, code in CODES.items() if any(_exists(folder, mark) for mark in code.marks)]
    explained = {other for name in marked for other in CODES[name].over}
    return [name for name in marked if name not in explained]


def read_predictions(folder: Path, scene: Scene, code: str | None = None) -> Predictions:
    """What the folder predicts of the scene's test views, in the layout of ``code`` or of the one that it bears.

    Raises UsageError for an unknown code, DataError for a folder that cannot be told or holds nothing for this scene.
    """
    if not folder.is_dir():
        raise DataError(f"there is no folder {folder}", "", "Give the folder that the code wrote its results into.")
    name = code if code is not None else _recognised(folder)
    if name not in CODES:
        near = get_close_matches(name, CODES, 1)
        hint = f"Did you mean '{near[0]}'?" if near else ""
        raise UsageError(f"no reader for '{name}'", hint, f"Readers: {', '.join(CODES)}.")
    layout = CODES[name]
    missing: list[str] = []
    absent: list[str] = []
    maps: dict[str, dict[str, Found]] = {view.name: {} for view in scene.test}
    for rule in (replace(rule, path=resolved(folder, rule.path)) for rule in layout.rules):
        for view, found in _search(folder, rule, scene, scene.test, "", missing, absent).items():
            maps[view][rule.map] = found
    relit = {}
    for light, views in relightable(scene).items():
        for rule in (replace(rule, path=resolved(folder, rule.path)) for rule in layout.relit):
            found_views = _search(folder, rule, scene, views, light, missing, absent)
            if found_views:
                relit[light] = found_views
    predictions = Predictions(name, maps, relit, tuple(missing), tuple(absent), layout.remarks)
    if predictions.files == 0:
        raise DataError(
            f"{folder} holds no prediction of scene '{scene.name}' as {layout.title} writes it",
            "Looked for: " + "; ".join(absent) + ".",
            "Name the code with --from, and the scene that was trained on with --scene.",
        )
    return predictions


def _search(
    folder: Path,
    rule: Rule,
    scene: Scene,
    views: Iterable[View],
    light: str,
    missing: list[str],
    absent: list[str],
) -> dict[str, Found]:
    """The rule's files by view; names those that lack, or the whole map if no view has it."""
    what = f"{rule.map} under {light}" if light else rule.map
    found, lacking = {}, []
    for view in views:
        index = scene.test.index(view)
        file = find(folder, rule, index, view.name, light)
        if file is None:
            lacking.append(spellings(rule, index, view.name, light)[0])
        else:
            found[view.name] = file
    if found:
        missing += [f"{what}: {path}" for path in lacking]
    elif lacking:
        absent.append(f"{what} ({lacking[0]})")
    return found


def _recognised(folder: Path) -> str:
    candidates = likely_codes(folder)
    if len(candidates) != 1:
        seen = f"It bears marks of {', '.join(candidates)}." if candidates else "It bears the marks of none."
        raise DataError(f"cannot tell which code wrote {folder}", seen, f"Say it with --from: {', '.join(CODES)}.")
    return candidates[0]


def _exists(folder: Path, mark: str) -> bool:
    return next(iter(folder.glob(mark)), None) is not None
