"""Finds the predictions of a scene in a folder: which file belongs to which map and view."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from radiogs_core.errors import DataError, unknown
from radiogs_core.scene.scene import Scene, View
from radiogs_datasets.bounded_reading import read_bytes
from radiogs_datasets.image_structure import image_header

from .codes import CODES, PLAIN
from .files import IMAGES, LOSSY, Found, find, indices, resolved, spellings, unread_files
from .layout import Rule
from .predictions import Predictions, relightable

KINDS_SHOWN = 3
"""Kinds of files that an error lists of a folder that is not recognised."""


def likely_codes(folder: Path) -> list[str]:
    """Codes whose marks the folder has, unless another of these codes writes the marks, too (``Code.over``)."""
    marked = [name for name, code in CODES.items() if any(any(folder.glob(mark)) for mark in code.marks)]
    explained = {other for name in marked for other in CODES[name].over}
    return [name for name in marked if name not in explained]


def read_predictions(folder: Path, scene: Scene, code: str | None = None, *, numbered: bool = True) -> Predictions:
    """The predictions of a scene's test views in a folder.

    ``code``: name of the layout; None recognises it by its marks. Without ``numbered``, files of the layout ``plain``
    are found by name alone, where the order of ``scene.test`` is not that of the numbers. Raises UsageError for an
    unknown code. Raises DataError if the layout is not recognised, if the folder has no prediction of this scene, or if
    it has files for more views than the scene.
    """
    if not folder.is_dir():
        raise DataError(f"there is no folder {folder}", "", "Give the folder that the code wrote its results into.")
    name = code if code is not None else _recognised(folder, scene)
    if name not in CODES:
        raise unknown("reader", name, CODES)
    layout = CODES[name]
    search = _Search(folder, scene, numbered=numbered)
    maps: dict[str, dict[str, Found]] = {view.name: {} for view in scene.test}
    for kind in dict.fromkeys(rule.map for rule in layout.rules):
        for view, found in search.first(kind, layout.rules_of(kind), scene.test).items():
            maps[view][kind] = found
    lit = {
        light: search.first(f"relit under {light}", layout.relit, views, light)
        for light, views in relightable(scene).items()
    }
    relit = {light: views for light, views in lit.items() if views}
    light = next((path for file in layout.environment for path in sorted(folder.glob(file))), None)
    read = {found.path for views in (*maps.values(), *relit.values()) for found in views.values()}
    if light is not None:
        read.add(light)
    if not read:
        left_out = "".join(f" {reason}." for reason in search.left_out)
        raise DataError(
            f"{folder} holds no prediction of scene '{scene.name}' as {layout.title} writes it",
            f"It has none of these files: {'; '.join(search.absent)}.{left_out}",
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
        remarks=(*layout.remarks, *search.said),
    )


class _Search:
    """Searches for the files of a scene's views, and records missing ones."""

    def __init__(self, folder: Path, scene: Scene, *, numbered: bool = True) -> None:
        self.folder, self.scene, self.numbered = folder, scene, numbered
        self.missing: list[str] = []
        self.absent: list[str] = []
        self.left_out: list[str] = []
        self.said: list[str] = []
        self.wrong_size: set[Path] = set()
        self._index = {view.name: index for index, view in enumerate(scene.test)}

    def first(self, what: str, rules: Sequence[Rule], views: Sequence[View], light: str = "") -> dict[str, Found]:
        """Files, by view, of the first rule that has any.

        Views without a file are added to ``missing``; if no rule has any file, their paths are added to ``absent``.
        """
        chosen: tuple[Rule, dict[str, Found]] | None = None
        rules = [
            replace(rule, path=resolved(self.folder, rule.path)) for rule in rules if self.numbered or not rule.numbered
        ]
        for rule in rules:
            if chosen is not None and not (rule.numbered and len(chosen[1]) < len(views)):
                continue
            if not rule.numbered:
                self._require_no_more_views(rule, light)
            files = {v.name: find(self.folder, rule, self._index[v.name], v.name, light) for v in views}
            there = {name: file for name, file in files.items() if file is not None}
            complete = chosen is None or len(there) == len(views)
            if there and complete and self._has_the_views_size(what, rule, there, views):
                chosen = rule, there
        if chosen is None:
            named = [self._example(rule, views[0], light) for rule in rules if not rule.numbered]
            self.absent.append(f"{what} ({', '.join(named)})")
            return {}
        rule, there = chosen
        if rule.numbered:
            self._require_no_more_views(rule, light)
        if rule.numbered or (rules[-1].numbered and rule is not rules[0]):
            name, first = next(iter(there.items()))
            self.said.append(f"{what}: {first.path.relative_to(self.folder)} is read as view '{name}'")
        if lossy := [found.path.name for found in there.values() if found.path.suffix.lower() in LOSSY]:
            seen = f"{len(lossy)} files are JPEG ({lossy[0]}, ...)"
            self.said.append(f"{what}: {seen}: what compression lost counts as error")
        self.missing += [f"{what}: {self._example(rule, v, light)}" for v in views if v.name not in there]
        return there

    def _example(self, rule: Rule, view: View, light: str) -> str:
        return spellings(rule, self._index[view.name], view.name, light)[0]

    def _require_no_more_views(self, rule: Rule, light: str) -> None:
        count, found = len(self.scene.test), indices(self.folder, rule, light)
        if max(found, default=-1) < count:
            return
        but = "with another list each is of a wrong view"
        remedy = "Name the scene that the code was evaluated on, with all its test views."
        if found == {*range(1, count + 1)}:
            but, name = f"these run from 1 to {count}", self.scene.test[0].name
            remedy = f"Number them from 0 to {count - 1}, or call them as the views are ('{name}', ...)."
        what = f"{self.folder} counts views up to {max(found)}, scene '{self.scene.name}' has {count} test views"
        raise DataError(what, f"Files of {rule.path} are numbered by the list of test views, from 0 on; {but}.", remedy)

    def _has_the_views_size(self, what: str, rule: Rule, files: dict[str, Found], views: Sequence[View]) -> bool:
        if not rule.other_size:
            return True
        name, first = next(iter(files.items()))
        camera = next(view.camera for view in views if view.name == name)
        height, width = image_header(first.path, read_bytes(first.path)).size
        if (height, width) == (camera.height, camera.width):
            return True
        self.wrong_size |= {file.path for file in files.values()}
        sizes = f"{width} x {height} pixels, the view has {camera.width} x {camera.height}"
        self.left_out.append(f"{what} ({rule.path}): {sizes}; {rule.other_size}")
        return False


def _recognised(folder: Path, scene: Scene) -> str:
    """The code whose marks the folder has; ``plain`` for images without marks that are called or numbered as views.

    Raises DataError, with what lies in the folder and what the images would have to be called.
    """
    candidates = likely_codes(folder)
    if len(candidates) == 1:
        return candidates[0]
    last, view = len(scene.test) - 1, scene.test[0].name
    inner: list[str] = []
    if candidates:
        seen = f"It has files of {', '.join(candidates)}."
    elif _Search(folder, scene).first("image", PLAIN.rules_of("image"), scene.test):
        return "plain"
    else:
        kinds = unread_files(folder, set(), ())
        more = [f"and {len(kinds) - KINDS_SHOWN} more kinds"] if len(kinds) > KINDS_SHOWN else []
        lies = "; ".join([*kinds[:KINDS_SHOWN], *more])
        seen = f"It has the files of no known code. Its images: {lies or 'none'}{_of_other_size(folder, scene)}."
        inner = [str(place) for place in sorted(folder.glob("**/")) if place != folder and _holds(place, scene)]
    raise DataError(
        f"cannot tell which code wrote {folder}",
        seen,
        (f"Give the folder that holds them: {', '.join(inner)}. Or call" if inner else "Call")
        + f" the images as the test views are ('{view}.png', ...) or number them from 0 to {last} in their order; or"
        f" name the code with --from: {', '.join((*CODES, 'stanford-orb'))}.",
    )


def _holds(folder: Path, scene: Scene) -> bool:
    """Whether a folder has an image for each test view, by name or number."""
    try:
        return len(_Search(folder, scene).first("image", PLAIN.rules_of("image"), scene.test)) == len(scene.test)
    except DataError:
        return False


def _of_other_size(folder: Path, scene: Scene) -> str:
    """The size of the first image of a folder, where the views have another."""
    camera = scene.test[0].camera
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() in {*IMAGES} - {".npy"}:
            height, width = image_header(path, read_bytes(path)).size
            if (height, width) == (camera.height, camera.width):
                return ""
            beside = ": several side by side? Cut out the renders" if width > camera.width else ""
            sizes = f"{width} x {height} pixels, the views {camera.width} x {camera.height}"
            return f"; {path.name} has {sizes}{beside}"
    return ""
