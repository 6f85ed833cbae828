"""A public code as a method: its stages, rendering and relighting are commands with their own environment."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from radiogs_core.contract import Run, StageSpec
from radiogs_core.errors import DataError, UsageError

from .file import PRESETS, MethodFile, TrainCommand, read_file
from .placeholders import filled_list
from .process import CommandFailed
from .records import Listing, Record, digest_of_order, listing_of
from .task import Attempt, Task
from .trained import WAIT, TrainedCommand
from .workspace import Workspace


@dataclass(frozen=True)
class CommandVariant:
    """The settings that a suite's row may change."""

    arguments: tuple[str, ...] = ()
    """Further arguments of the training command that has the placeholder ``{arguments}``, or else of the last one."""


@dataclass(frozen=True)
class CommandBudget:
    """Iterations of a preset, for placeholders of the commands."""

    name: str
    """Name of the preset."""
    iterations: int = 0
    """Iterations of the first stage."""
    further: int = 0
    """Iterations of the later stages."""


@dataclass(frozen=True)
class CommandMethod:
    """A method whose stages are commands."""

    file: MethodFile
    """Content of the method's file."""
    home: Path
    """Folder of that file."""

    variant = CommandVariant
    sources = (__name__,)

    @property
    def name(self) -> str:
        """Name of the method in suites and after ``--method``."""
        return self.file.name

    @property
    def title(self) -> str:
        """Name of the method in tables."""
        return self.file.title

    @property
    def presets(self) -> Mapping[str, CommandBudget]:
        """The four presets, with the iterations of the method's file."""
        return {name: CommandBudget(name, **asdict(self.file.iterations(name))) for name in PRESETS}

    def stages(self, variant: CommandVariant, budget: CommandBudget) -> Sequence[StageSpec]:
        """One stage for each command of training."""
        reads = decisive(self.file) | {
            "further_arguments": list(variant.arguments),
            "iterations": [budget.iterations, budget.further],
        }
        return [
            StageSpec(
                name=command.name,
                title=command.title or f"{self.title}: {command.name}",
                steps=1,
                owner=self.name,
                reads=reads,
                sources=(__name__,),
                begin=partial(self._begin, number),
                keeps_files=True,
            )
            for number, command in enumerate(self.file.train)
        ]

    def restore(self, run: Run, tensors: Mapping[str, Any]) -> TrainedCommand:
        """The model from the product of the last stage. Raises DataError if its files are gone or changed."""
        workspace = Workspace.of(self.file, self.home, run)
        self._require_whole(workspace, tensors)
        made_by = digest_of_order(*self._decides(run), [Record(**each).files for each in tensors.values()])
        return TrainedCommand(workspace, tensors, made_by)

    def _begin(self, number: int, run: Run, product: Mapping[str, Any]) -> "CommandStage":
        workspace = Workspace.of(self.file, self.home, run)
        self._require_whole(workspace, product)
        return CommandStage(self._task(workspace, number), product, partial(self._forget_after, workspace, number))

    def _task(self, workspace: Workspace, number: int) -> Task:
        command = self.file.train[number]
        return Task(
            workspace=workspace,
            name=command.name,
            order=digest_of_order(*self._decides(workspace.run), [command.name]),
            arguments=partial(self._arguments, workspace, number),
            wrote=partial(written, workspace, command),
            time_limit=command.time_limit,
            resumes=self.file.resumes,
            before=workspace.write_lights,
        )

    def _arguments(self, workspace: Workspace, number: int, resuming: bool) -> Sequence[str]:
        train, command = self.file.train, self.file.train[number]
        texts = list(command.arguments)
        if command is train[-1] and not any("{arguments}" in each.arguments for each in train):
            texts.append("{arguments}")
        if "{resume}" not in texts:
            texts.append("{resume}")
        values, lists = workspace.values(), workspace.settings
        resume = filled_list(command.resume, values, lists) if resuming else ()
        return filled_list(texts, values, {**lists, "arguments": workspace.run.variant.arguments, "resume": resume})

    def _decides(self, run: Run) -> list[Sequence[str]]:
        """Everything that decides the files of a workspace, as text."""
        budget = [str(run.budget.iterations), str(run.budget.further)]
        scene = [run.scene.checksum, str(run.seed), run.device.type]
        return [[repr(sorted(decisive(self.file).items()))], list(run.variant.arguments), budget, scene]

    def _forget_after(self, workspace: Workspace, number: int) -> None:
        """Delete the records of all later commands, which are void because this command runs again."""
        later = [each.name for each in self.file.train[number + 1 :]]
        for folder in (workspace.done("").parent, workspace.begun("").parent):
            for path in folder.glob("*.json"):
                if path.stem in later or path.stem == "render" or path.stem.startswith("relight"):
                    path.unlink(missing_ok=True)

    def _require_whole(self, workspace: Workspace, product: Mapping[str, Any]) -> None:
        """Raise DataError unless the files of all earlier commands exist unchanged."""
        for command in self.file.train:
            if command.name in product:
                record = Record(**product[command.name])
                require_unchanged(workspace, record, partial(written, workspace, command))


class CommandStage:
    """A command of training as a stage with a single step, which is done when the command has succeeded."""

    iterations = 1

    def __init__(self, task: Task, product: Mapping[str, Any], forget: Callable[[], None]) -> None:
        self.iteration = 0
        self._task, self._product, self._forget = task, dict(product), forget
        self._record: Record | None = None
        self._attempt: Attempt | None = None

    def step(self) -> dict[str, float]:
        """Start the command, or wait for it up to WAIT seconds. Raises CommandFailed."""
        if self._record is None:
            # The command may have finished after the harness was killed, or before its state was stored.
            self._record = self._task.done() if self._attempt is None else None
        if self._record is None:
            if self._attempt is None:
                self._forget()
                self._attempt = self._task.begin()
            self._record = self._attempt.poll(WAIT)
        if self._record is not None:
            self.iteration = 1
        return {}

    def close(self) -> None:
        """End the command and all its children, if it is running."""
        if self._attempt is not None:
            self._attempt.end()
            self._attempt = None

    def state(self) -> dict[str, Any]:
        """The command's record under ``done``, or None before it has succeeded."""
        return {"done": None if self._record is None else asdict(self._record)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a state; a command that is not done starts again. Raises DataError if its files are gone."""
        if state["done"] is not None:
            self._record = Record(**state["done"])
            require_unchanged(self._task.workspace, self._record, self._task.wrote)
            self.iteration = 1

    def product(self) -> dict[str, Any]:
        """Records of this and all earlier commands, by name. Raises UsageError before the command has succeeded."""
        if self._record is None:
            raise UsageError(
                f"{self._task.workspace.file.title} cannot be scored before the command '{self._task.name}' has ended",
                "A command writes its results when it ends.",
                "Leave this method out of scores that are taken during training.",
            )
        return {**self._product, self._task.name: asdict(self._record)}


def read_method(path: Path) -> CommandMethod:
    """The method of a TOML file. Raises DataError if it cannot be read, and UsageError if a value in it is wrong."""
    return CommandMethod(read_file(path), path.absolute().parent)


def decisive(file: MethodFile) -> dict[str, Any]:
    """The fields of a file that decide a method's results, as plain values."""
    plain = asdict(file)
    for name in ("title", "layouts", "traps", "presets"):
        del plain[name]
    for name in ("licence", "variable", "folder", "python"):
        del plain["code"][name]
    for command in (*plain["train"], plain["render"], plain["relight"]):
        if command is not None:
            command.pop("title", None)
            del command["time_limit"]
    return plain


def written(workspace: Workspace, command: TrainCommand) -> Listing:
    """The files that a command of training has written. Raises CommandFailed for a pattern that matches no file."""
    found: dict[str, int] = {}
    for pattern in command.writes:
        path = Path(pattern.format_map(workspace.named())).relative_to(workspace.output)
        files = [workspace.output] if path == Path() else sorted(workspace.output.glob(str(path)))
        listing = listing_of(workspace.root, files)
        if not listing:
            raise CommandFailed(f"there is no {pattern}", f"{{output}} is {workspace.output}.")
        found |= listing
    return found


def require_unchanged(workspace: Workspace, record: Record, wrote: Callable[[], Listing]) -> None:
    """Raise DataError unless the files that a command ``wrote`` are there and unchanged."""
    if not record.matches(wrote):
        raise DataError(
            f"files that the command '{record.command}' of {workspace.file.title} has written are missing or changed",
            f"{workspace.output} should hold {record.file_count} files of it with {record.file_bytes} bytes.",
            f"Restore the folder; or remove {workspace.root} and the stored stages of this cell, to train it again.",
        )
