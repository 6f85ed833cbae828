"""Finds the predictions of a scene in a folder: which file belongs to which map and view."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from radiogs_core.errors import DataError, unknown
from radiogs_core.scene.scene import Scene, View
from radiogs_datasets.bounded_reading import read_bytes
from radiogs_datasets.image_structure import image_size

from .codes import CODES
from .files import Found, find, last_index, resolved, spellings
from .predictions import Predictions, relightable
from .rules import Rule
from .unread import unread_files


def likely_codes(folder: Path) -> list[str]:
    """Codes whose marks the folder has, without those whose marks another of these codes also writes
    (``Code.over``)."""
    marked = [name for name, code in CODES.items() if any(_exists(folder, mark) for mark in code.marks)]
    explained = {other for name in marked for other in CODES[name].over}
    return [name for name in marked if name not in explained]


def read_predictions(folder: Path, scene: Scene, code: str | None = None) -> Predictions:
    """The predictions of a scene's test views in a folder.

    ``code``: name of the layout; None recognises it by its marks. Raises UsageError for an unknown code. Raises
    DataError if the layout is not recognised, if the folder has no prediction of this scene, or if it has files for
    more views than the scene.
    """
    if not folder.is_dir():
        raise DataError(f"there is no folder {folder}", "", "Give the folder that the code wrote its results into.")
    name = code if code is not None else _recognised(folder)
    if name not in CODES:
        raise unknown("reader", name, CODES)
    layout = CODES[name]
    search = _Search(folder, scene)
    maps: dict[str, dict[str, Found]] = {view.name: {} for view in scene.test}
    for kind in dict.fromkeys(rule.map for rule in layout.rules):
        rules = [rule for rule in layout.rules if rule.map == kind]
        for view, found in search.first(kind, rules, scene.test).items():
            maps[view][kind] = found
    lit = {
        light: search.first(f"relit under {light}", layout.relit, views, light)
        for light, views in relightable(scene).items()
    }
    relit = {light: views for light, views in lit.items() if views}
    light = next((folder / file for file in layout.environment if (folder / file).is_file()), None)
    read = {found.path for views in (*maps.values(), *relit.values()) for found in views.values()}
    if light is not None:
        read.add(light)
    if not read:
        raise DataError(
            f"{folder} holds no prediction of scene '{scene.name}' as {layout.title} writes it",
            "It has none of these files: "
            + "; ".join(search.absent)
            + "."
            + "".join(f" {reason}." for reason in search.left_out),
            "Name the code with --from, and the scene that it was trained on with --scene.",
        )
    return Predictions(
        folder=folder,
        code=name,
        maps=maps,
        relit=relit,
        light=light,
        missing=tuple(search.missing),
        absent=tuple(search.absent),
        ignored=(*search.left_out, *unread_files(folder, read | search.wrong_size, layout.unread)),
        remarks=layout.remarks,
    )


class _Search:
    """Searches for the files of a scene's views, and records those that are missing."""

    def __init__(self, folder: Path, scene: Scene) -> None:
        self.folder, self.scene = folder, scene
        self.missing: list[str] = []
        self.absent: list[str] = []
        self.left_out: list[str] = []
        self.wrong_size: set[Path] = set()
        self._index = {view.name: index for index, view in enumerate(scene.test)}

    def first(self, what: str, rules: Sequence[Rule], views: Sequence[View], light: str = "") -> dict[str, Found]:
        """Files, by view, of the first rule that has any.

        Views without a file are added to ``missing``; if no rule has any file, their paths are added to ``absent``.
        """
        examples = []
        for rule in (replace(rule, path=resolved(self.folder, rule.path)) for rule in rules):
            self._require_no_more_views(rule, light)
            found = {view.name: self._find(rule, view, light) for view in views}
            there = {name: file for name, file in found.items() if file is not None}
            if there and self._has_the_views_size(what, rule, there, views):
                self.missing += [f"{what}: {self._example(rule, v, light)}" for v in views if found[v.name] is None]
                return there
            examples.append(self._example(rule, views[0], light))
        self.absent.append(f"{what} ({', '.join(examples)})")
        return {}

    def _find(self, rule: Rule, view: View, light: str) -> Found | None:
        return find(self.folder, rule, self._index[view.name], view.name, light)

    def _example(self, rule: Rule, view: View, light: str) -> str:
        return spellings(rule, self._index[view.name], view.name, light)[0]

    def _require_no_more_views(self, rule: Rule, light: str) -> None:
        count, last = len(self.scene.test), last_index(self.folder, rule, light)
        if last >= count:
            raise DataError(
                f"{self.folder} counts views up to {last}, scene '{self.scene.name}' has {count} test views",
                f"Files of {rule.path} are numbered by the list of test views; with another list each is compared "
                "with a wrong view.",
                "Name the scene that the code was evaluated on, with all its test views.",
            )

    def _has_the_views_size(self, what: str, rule: Rule, files: dict[str, Found], views: Sequence[View]) -> bool:
        if not rule.other_size:
            return True
        name, first = next(iter(files.items()))
        camera = next(view.camera for view in views if view.name == name)
        height, width = image_size(first.path, read_bytes(first.path))
        if (height, width) == (camera.height, camera.width):
            return True
        self.wrong_size |= {file.path for file in files.values()}
        self.left_out.append(
            f"{what} ({rule.path}): {width} x {height} pixels, the view has {camera.width} x {camera.height}; "
            + rule.other_size
        )
        return False


def _recognised(folder: Path) -> str:
    candidates = likely_codes(folder)
    if len(candidates) != 1:
        seen = f"It has files of {', '.join(candidates)}." if candidates else "It has the files of no known code."
        raise DataError(
            f"cannot tell which code wrote {folder}",
            seen,
            f"Name the code with --from: {', '.join((*CODES, 'stanford-orb'))}.",
        )
    return candidates[0]


def _exists(folder: Path, mark: str) -> bool:
    return next(iter(folder.glob(mark)), None) is not None
