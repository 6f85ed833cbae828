"""The workspace of a run's commands: its folders, and the values of placeholders."""

import os
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from radiogs_core.contract import Run
from radiogs_core.errors import UsageError
from radiogs_core.own_files import own_folder
from radiogs_core.scene.light import EnvironmentMap
from radiogs_datasets.image_files import write_exr, write_hdr

from .file import MethodFile, RelightCommand
from .process import CommandFailed


@dataclass(frozen=True)
class Workspace:
    """The workspace of a run."""

    file: MethodFile
    """Content of the method's file."""
    home: Path
    """Folder of that file."""
    run: Run
    root: Path
    """Folder of the workspace."""

    @staticmethod
    def of(file: MethodFile, home: Path, run: Run) -> "Workspace":
        """The workspace of ``run``. Raises UsageError for a run without a folder, or a scene the code cannot read."""
        if run.workspace is None:
            raise UsageError(
                f"{file.title} needs a folder for its files, and this run has none",
                "Its commands write their results as files, which this engine does not keep.",
                "Use an engine that runs on this machine.",
            )
        scene = run.scene
        if scene.folder is None:
            raise UsageError(
                f"{file.title} cannot read scene '{scene.name}'",
                "Its commands read files, and this scene is computed.",
                "Choose a scene that is stored in a folder, or a method that is not run as commands.",
            )
        if scene.options.keys() - {"layout"}:
            asked = ", ".join(f"{name} {value}" for name, value in scene.options.items())
            raise UsageError(
                f"{file.title} cannot read scene '{scene.name}' with these options: {asked}",
                "Its commands read the stored files, which have other images or other views.",
                "Store the scene with these options first:  radiogs-bench datasets convert",
            )
        if any(view.has("valid") for view in (*scene.train, *scene.test)):
            raise UsageError(
                f"{file.title} cannot leave pixels of scene '{scene.name}' out",
                "Its transforms file says that black pixels of masks are ignored, which the commands do not know.",
                "Choose a method that is not run as commands.",
            )
        if scene.layout not in file.layouts:
            raise UsageError(
                f"{file.title} cannot read scene '{scene.name}', which is in the layout {scene.layout}",
                f"It reads: {', '.join(file.layouts)}.",
                "Convert the scene (docs/datasets.md), or add the layout to the method's file if the code reads it.",
            )
        return Workspace(file, home, run, run.workspace.absolute())

    @property
    def output(self) -> Path:
        """The folder that replaces ``{output}``."""
        return self.root / "output"

    @property
    def lights(self) -> Path:
        """The folder that replaces ``{lights}``."""
        return self.root / "lights"

    @property
    def results(self) -> Path:
        """The folder from which results are read."""
        return Path(self.file.results.format_map(self.named()))

    def log(self, command: str) -> Path:
        """Path of a command's log."""
        return self.root / "logs" / f"{command}.log"

    def done(self, command: str) -> Path:
        """Path of the record of a command that has succeeded."""
        return self.root / "done" / f"{command}.json"

    def begun(self, command: str) -> Path:
        """Path of the list of files that existed before a command was started for the first time."""
        return self.root / "begun" / f"{command}.json"

    def named(self) -> dict[str, str]:
        """Values of the placeholders that may occur in paths of results."""
        run, budget = self.run, self.run.budget
        return {
            "scene": str(Path(run.scene.folder or "").absolute()),
            "scene_name": run.scene.name,
            "output": str(self.output),
            "lights": str(self.lights),
            "seed": str(run.seed),
            "threads": str(torch.get_num_threads()),
            "device": str(run.device),
            "iterations": str(budget.iterations),
            "further": str(budget.further),
            "total": str(budget.iterations + budget.further),
        }

    def values(self, light: str = "") -> dict[str, str]:
        """Values of all placeholders; ``light``: to relight under. Raises UsageError if the code is not found."""
        interpreter = os.environ.get(self.file.code.python) if self.file.code.python else None
        values = self.named() | {"code": str(self._checkout()), "python": interpreter or "python"}
        if light:
            values |= {"light": light, "light_file": str(self._light_file(light))}
        return values

    @property
    def settings(self) -> Mapping[str, Sequence[str]]:
        """The file's lists of arguments for this scene: its own go before its layout's."""
        scene, others = self.run.scene, self.file.scenes
        return {**self.file.settings, **others.get(scene.layout, {}), **others.get(scene.name, {})}

    def working_folder(self, values: Mapping[str, str]) -> Path:
        """The folder in which commands run; it is created if it lies in the workspace."""
        folder = Path(self.file.working_folder.format_map(values)).absolute()
        if folder.is_relative_to(self.root):
            self.make(folder)
        return folder

    def write_lights(self) -> None:
        """Write the scene's lights for the commands that read them: lat-long, Z up, centre column towards +X."""
        if self.file.placeholders.isdisjoint({"lights", "light_file"}):
            return
        self.make(self.lights)
        for name, light in self.run.scene.lights.items():
            _write_light(self._light_file(name), light)

    def make(self, folder: Path) -> None:
        """Create a folder of the workspace. Raises CommandFailed if the system refuses, UsageError for a link."""
        try:
            own_folder(folder, self.root)
        except OSError as error:
            raise CommandFailed(
                f"cannot create the folder {folder}: {error.strerror}",
                "Commands write their results there.",
                "Free disk space, or choose a folder that can be written.",
            ) from error

    def found_commit(self) -> str | None:
        """The commit of the checkout; None if git does not know it."""
        try:
            asked = ["git", "-C", str(self._checkout()), "rev-parse", "HEAD"]
            said = subprocess.run(asked, capture_output=True, text=True, timeout=10, check=True)
        except (OSError, subprocess.SubprocessError, UsageError):
            return None
        return said.stdout.strip()

    def _light_file(self, light: str) -> Path:
        return self.lights / f"{light}{(self.file.relight or RelightCommand(())).light_suffix}"

    def _checkout(self) -> Path:
        code = self.file.code
        named = os.environ.get(code.variable, "") if code.variable else ""
        folder = Path(named) if named else self.home / code.folder
        if (named or code.folder) and folder.is_dir():
            return folder.absolute()
        get = f"git clone --recursive {code.url} && git checkout {code.commit}" if code.url else "it has no 'url'"
        if not named and not code.folder:
            raise UsageError(
                f"{self.file.title}: its code is not found",
                f"The environment variable {code.variable}, which holds the folder of a checkout, is not set.",
                f"Get it ({get}), install it as its authors say, and set {code.variable} to its folder.",
            )
        asked = f"The environment variable {code.variable} names it." if named else "The method's file names it."
        raise UsageError(f"{self.file.title}: there is no folder {folder}", asked, f"Get the code: {get}.")


def _write_light(path: Path, light: EnvironmentMap) -> None:
    """Write a light with negative values set to zero; the file is replaced at once, as another command may read it."""
    temporary = path.with_name(f".{path.stem}.new{path.suffix}")
    radiance = light.radiance.detach().cpu().float().clamp(min=0).numpy()
    try:
        (write_hdr if path.suffix == ".hdr" else write_exr)(temporary, radiance)
        temporary.replace(path)
    except OSError as error:
        raise CommandFailed(f"cannot write {path}: {error.strerror}", "", "Free disk space, and run again.") from error
