"""The trained model of a public code: its commands render and relight it, and its layout's reader reads the files."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import STANDARD_MAPS, MapKind, Maps, NotOffered
from radiogs_core.errors import DataError
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene, View
from radiogs_datasets.bounded_reading import read_bytes
from radiogs_datasets.image_structure import image_header

from ..outputs.codes import CODES
from ..outputs.files import Found
from ..outputs.predictions import Predictions, relightable
from ..outputs.reading import read_predictions
from .file import RelightCommand, RenderCommand
from .placeholders import filled_list
from .process import CommandFailed
from .records import digest_of_order, listing_of, read_record
from .task import Task
from .workspace import Workspace

WAIT = 0.5
"""Seconds that a step waits for a command: an interruption is noticed, and ``after_step`` called, after this time."""

KINDS: Mapping[str, MapKind] = {**STANDARD_MAPS, "incident": MapKind("linear")}
"""Kinds of the maps that readers return; all maps are on black."""

SHOWN = 6
"""Largest number of missing files that a message names."""


@dataclass(frozen=True)
class PreparedCommand:
    """A rendered model, whose maps are files. A ``contract.Prepared``."""

    title: str
    """Name of the method in messages."""
    offers: Mapping[str, MapKind]
    """Kinds of the maps, by name."""
    views: Sequence[tuple[View, Predictions]]
    """Rendered views, each with the predictions that have its files."""
    light: str = ""
    """Name of the light of the views; empty: the light of the training views."""
    timed: bool = False
    """Whether ``render`` may be timed: no, because it reads files."""

    @property
    def default(self) -> frozenset[str]:
        """Names of all maps, which exist as files."""
        return frozenset(self.offers)

    def render(self, camera: Camera, *further: str) -> Maps:
        """The maps of the view with this camera. Raises DataError if no view has it, or if a file is damaged."""
        for view, found in self.views:
            if same_camera(view.camera, camera):
                coverage = view.read("alpha") if view.has("alpha") else torch.ones(camera.height, camera.width, 1)
                if self.light:
                    return {"image": found.read_relit(self.light, view, coverage)}
                return found.read(view, coverage)
        raise DataError(
            f"{self.title} was not rendered from this camera",
            f"Its commands render the views of the scene; {len(self.views)} of them are available.",
            "Leave out metrics that need other cameras.",
        )


@dataclass(frozen=True)
class TrainedCommand:
    """A trained model in the workspace of a run. A ``contract.Trained``."""

    workspace: Workspace
    product: Mapping[str, Any]
    """Records of the commands of training, by name."""
    order: str
    """Digest of everything that decides the model."""

    @property
    def light(self) -> EnvironmentMap | None:
        """The recovered light; None before the test views are rendered, or if the layout does not store it."""
        found = self._found()
        return None if found is None else found.read_light()

    def facts(self) -> dict[str, Any]:
        """The code and its commands with their cost, remarks on the code, and files of its output that are not read."""
        code, found = self.workspace.file.code, self.workspace.found_commit()
        commands = dict(self.product)
        for path in sorted(self.workspace.done("").parent.glob("*.json")):
            record = read_record(path)
            if record is not None and record.command not in commands and record.order.startswith(self.order):
                commands[record.command] = asdict(record)
        predictions = self._found()
        remarks = [*self.workspace.file.traps, *CODES[self.workspace.file.reader].remarks]
        if found is not None and not found.startswith(code.commit):
            remarks.append(f"The commands are for commit {code.commit}; the checkout is at {found}.")
        if self.workspace.file.relight is None:
            remarks.append("It is not relit, because its file has no command that relights.")
        return {
            "code": {"url": code.url, "commit": code.commit, "licence": code.licence, "found": found},
            "commands": commands,
            "logs": {name: str(self.workspace.root / record["log"]) for name, record in commands.items()},
            "remarks": remarks,
            "absent": [] if predictions is None else list(predictions.absent),
            "ignored": [] if predictions is None else list(predictions.ignored),
        }

    def export(self, folder: Path) -> list[Path]:
        """Write ``where.json``, which names the folders and facts of the model; returns its path. Raises OSError."""
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / "where.json"
        where = {
            "method": self.workspace.file.name,
            "workspace": str(self.workspace.root),
            "output": str(self.workspace.output),
            "results": str(self.workspace.results),
            "logs": str(self.workspace.log("").parent),
            "facts": self.facts(),
        }
        path.write_text(json.dumps(where, indent=1), encoding="utf-8")
        return [path]

    def prepare(
        self,
        light: EnvironmentMap | None = None,
        albedo_scale: Float[Tensor, "3"] | None = None,
        after_step: Callable[[], None] = lambda: None,
    ) -> PreparedCommand:
        """Run the command that renders the test views, or relights them, unless it has been run.

        ``albedo_scale`` is ignored: public codes scale albedo themselves, if at all. Raises CommandFailed; DataError
        for a light outside the scene; NotOffered if the method has no command that relights.
        """
        if light is None:
            if (rendering := self.workspace.file.render) is not None:
                self._bring_about(self._task(rendering, "render", ["render"], self._own_files), after_step)
            else:
                self._own_files()
            found = self._read()
            offered = {name: KINDS[name] for maps in found.maps.values() for name in maps}
            views = [(view, found) for view in self.workspace.run.scene.test]
            return PreparedCommand(self.workspace.file.title, offered, views)
        name, relighting = self._name_of(light), self.workspace.file.relight
        if relighting is None:
            raise NotOffered(f"{self.workspace.file.title} has no command that relights")
        lights, one = (sorted(self._lit_views()), "") if relighting.all_lights else ([name], name)
        task, files = f"relight-{one}".rstrip("-"), partial(self._relit_files, lights)
        self._bring_about(self._task(relighting, task, ["relight", one], files, one), after_step)
        read = [(scene, self._read(scene)) for scene in self._lit_views()[name]]
        views = [(view, found) for scene, found in read for view in scene.test if view.has(f"relit/{name}")]
        return PreparedCommand(self.workspace.file.title, {"image": KINDS["image"]}, views, name)

    def _bring_about(self, task: Task, after_step: Callable[[], None]) -> None:
        if task.done() is not None:
            return
        attempt = task.begin()
        try:
            while attempt.poll(WAIT) is None:
                after_step()
        finally:
            attempt.end()

    def _task(
        self,
        command: RenderCommand | RelightCommand,
        name: str,
        order: list[str],
        files: Callable[[], list[Found]],
        light: str = "",
    ) -> Task:
        """The task of a command that has to write ``files``, which raises CommandFailed for a missing one."""
        workspace = self.workspace
        return Task(
            workspace=workspace,
            name=name,
            order=self.order + digest_of_order(order),
            arguments=lambda resuming: filled_list(command.arguments, workspace.values(light), workspace.settings),
            wrote=lambda: listing_of(workspace.root, (found.path for found in files())),
            light=light,
            time_limit=command.time_limit,
            before=workspace.write_lights,
            inspect=lambda: _inspect(files()),
        )

    def _own_files(self) -> list[Found]:
        """The files of the test views. Raises CommandFailed if a map is missing for some views, or a required map."""
        found, command = self._read(), self.workspace.file.render
        missing = [each for each in found.missing if not each.startswith("relit ")]
        there = {name for maps in found.maps.values() for name in maps}
        missing += [f"{name} of all views" for name in (command.maps if command else ()) if name not in there]
        _require_none(missing, found.ignored)
        return [each for maps in found.maps.values() for each in maps.values()]

    def _relit_files(self, lights: Sequence[str]) -> list[Found]:
        """The files of the views under some lights. Raises CommandFailed if a view has none."""
        files: list[Found] = []
        missing = []
        for light in lights:
            for scene in self._lit_views()[light]:
                relit = self._read(scene).relit.get(light, {})
                files += relit.values()
                wanted = [view.name for view in scene.test if view.has(f"relit/{light}")]
                missing += [f"{name} under {light}" for name in wanted if name not in relit]
        _require_none(missing)
        return files

    def _lit_views(self) -> dict[str, list[Scene]]:
        """For each light, scenes whose test views are the views under that light.

        If any test view exists under the light, all are kept, because they number the files. Views of the object in
        other surroundings (``Scene.relight``) have one light each, and their files are named by the view.
        """
        scene = self.workspace.run.scene
        lit: dict[str, list[Scene]] = {light: [scene] for light in relightable(scene)}
        by_name = any("{name}" in rule.path for rule in CODES[self.workspace.file.reader].relit)
        for light in scene.lights if by_name else ():
            elsewhere = tuple(view for view in scene.relight if view.has(f"relit/{light}"))
            if elsewhere:
                lit.setdefault(light, []).append(replace(scene, test=elsewhere))
        return lit

    def _read(self, scene: Scene | None = None) -> Predictions:
        """The predictions of a scene's test views; for other views than the run's, found by name alone."""
        own = self.workspace.run.scene
        return read_predictions(
            self.workspace.results, scene or own, self.workspace.file.reader, numbered=scene is None or scene is own
        )

    def _found(self) -> Predictions | None:
        """The predictions that can be read; None before the test views are rendered."""
        try:
            return self._read()
        except DataError:
            return None

    def _name_of(self, light: EnvironmentMap) -> str:
        lights = self.workspace.run.scene.lights
        for name, each in sorted(lights.items(), key=lambda item: item[1] is not light):
            if torch.equal(each.radiance.cpu(), light.radiance.cpu()):
                return name
        raise DataError(
            f"{self.workspace.file.title} cannot be relit by a light that is not one of the scene's",
            f"Its command reads the scene's lights: {', '.join(lights) or 'it has none'}.",
            "Relight it by one of them.",
        )


def same_camera(one: Camera, other: Camera) -> bool:
    """Whether two cameras have the same lens, image size and pose."""
    lens = [(each.fx, each.fy, each.cx, each.cy, each.width, each.height) for each in (one, other)]
    return lens[0] == lens[1] and torch.equal(one.camera_to_world.cpu(), other.camera_to_world.cpu())


def _inspect(files: Sequence[Found]) -> None:
    """Raise DataError for an image file that is truncated."""
    for path in sorted({found.path for found in files}):
        if path.suffix != ".npy":
            image_header(path, read_bytes(path))


def _require_none(missing: Sequence[str], unread: Sequence[str] = ()) -> None:
    """Raise CommandFailed if any file is missing; the message names unread files that exist."""
    if missing:
        more = f" and {len(missing) - SHOWN} more" if len(missing) > SHOWN else ""
        beside = f"Files that are not read: {'; '.join(unread[:SHOWN])}." if unread else ""
        raise CommandFailed(f"{len(missing)} missing: {', '.join(missing[:SHOWN])}{more}", beside)
