"""A method of strangers: a public code that is run as commands, behind the contract of every other method."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from radiogs_core.contract import Run, StageSpec
from radiogs_core.errors import DataError, UsageError

from .errors import CommandFailed
from .file import PRESETS, MethodFile, TrainCommand, read_file
from .place import Place
from .placeholders import filled, filled_list
from .records import Listing, Record, digest_of, digest_of_order, listing_of
from .task import Attempt, Task
from .trained import TrainedCommand

WAIT = 0.5
"""Seconds that a step waits for a command: how long an interruption goes unnoticed."""


@dataclass(frozen=True)
class CommandVariant:
    """What a suite's row may change: ``arguments`` are added to the command of training that says ``{arguments}``, or
    to the last."""

    arguments: tuple[str, ...] = ()


@dataclass(frozen=True)
class CommandBudget:
    """Iterations of the first stage and of what follows, as far as the commands ask for them."""

    name: str
    iterations: int = 0
    further: int = 0


@dataclass(frozen=True)
class CommandMethod:
    """A method whose stages are commands. ``home`` is the folder of its file."""

    file: MethodFile
    home: Path

    variant = CommandVariant
    sources = (__name__,)

    @property
    def name(self) -> str:
        """As suites and ``--method`` call it."""
        return self.file.name

    @property
    def title(self) -> str:
        """As tables print it."""
        return self.file.title

    @property
    def presets(self) -> Mapping[str, CommandBudget]:
        """The four presets; they differ as far as the file says."""
        return {name: CommandBudget(name, **asdict(self.file.iterations(name))) for name in PRESETS}

    def stages(self, variant: CommandVariant, budget: CommandBudget) -> Sequence[StageSpec]:
        """One stage a command of training."""
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
        place = Place.of(self.file, self.home, run)
        self._require_whole(place, tensors)
        made_by = digest_of_order(*self._decides(run), [Record.of(each).files for each in tensors.values()])
        return TrainedCommand(place, tensors, made_by)

    def _begin(self, number: int, run: Run, product: Mapping[str, Any]) -> "CommandStage":
        place = Place.of(self.file, self.home, run)
        self._require_whole(place, product)
        return CommandStage(self._task(place, number), product, partial(self._forget_after, place, number))

    def _task(self, place: Place, number: int) -> Task:
        command = self.file.train[number]
        return Task(
            place=place,
            name=command.name,
            order=digest_of_order(*self._decides(place.run), [command.name]),
            arguments=partial(self._arguments, place, number),
            wrote=partial(written, place, command),
            time_limit=command.time_limit,
            resumes=self.file.resumes,
            before=place.write_lights,
        )

    def _arguments(self, place: Place, number: int, resuming: bool) -> Sequence[str]:
        train = self.file.train
        taken = any("{arguments}" in each.arguments for each in train)
        command, further = train[number], place.run.variant.arguments
        texts = list(command.arguments)
        if not taken and number == len(train) - 1:
            texts.append("{arguments}")
        if "{resume}" not in texts:
            texts.append("{resume}")
        values = place.values()
        lists = place.settings
        resume = filled_list(command.resume, values, lists) if resuming else ()
        return filled_list(texts, values, {**lists, "arguments": further, "resume": resume})

    def _decides(self, run: Run) -> list[Sequence[str]]:
        """What a workspace's files are made by, as text."""
        budget = [str(run.budget.iterations), str(run.budget.further)]
        scene = [run.scene.checksum, str(run.seed), run.device.type]
        return [[repr(sorted(decisive(self.file).items()))], list(run.variant.arguments), budget, scene]

    def _forget_after(self, place: Place, number: int) -> None:
        """Take back the records of all that follows a command: it is run anew."""
        later = [each.name for each in self.file.train[number + 1 :]]
        for folder in (place.done("").parent, place.begun("").parent):
            for path in folder.glob("*.json"):
                if path.stem in later or path.stem == "render" or path.stem.startswith("relight"):
                    path.unlink(missing_ok=True)

    def _require_whole(self, place: Place, product: Mapping[str, Any]) -> None:
        """What the commands so far have written must be there, unchanged."""
        for command in self.file.train:
            record = product.get(command.name)
            if record is not None:
                _require_same(place, command, Record.of(record))


class CommandStage:
    """A command of training as a stage: its only step is taken when the command has ended well."""

    iterations = 1

    def __init__(self, task: Task, product: Mapping[str, Any], forget: Callable[[], None]) -> None:
        self.iteration = 0
        self._task, self._product, self._forget = task, dict(product), forget
        self._record: Record | None = None
        self._attempt: Attempt | None = None

    def step(self) -> dict[str, float]:
        """Start the command, or wait for it a little. Raises CommandFailed."""
        if self._record is None:
            # The command may have ended after the harness was killed, or while it noted that down.
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
        """End the command with all its children, if it runs."""
        if self._attempt is not None:
            self._attempt.end()
            self._attempt = None

    def state(self) -> dict[str, Any]:
        """Whether the command is done."""
        return {"done": None if self._record is None else self._record.plain()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state: what is not done is begun again. Raises DataError if what was done is gone."""
        if state["done"] is not None:
            self._record = Record.of(state["done"])
            listing = _listing(self._task.wrote)
            if listing is None or digest_of(listing) != self._record.files:
                raise _gone(self._task.place, self._record)
            self.iteration = 1

    def product(self) -> dict[str, Any]:
        """Records of all commands so far, by name. Raises UsageError while the command runs."""
        if self._record is None:
            raise UsageError(
                f"{self._task.place.file.title} cannot be shown before the command '{self._task.name}' has ended",
                "What a command has found is known when it has ended.",
                "Leave this method out of what is scored along the way.",
            )
        return {**self._product, self._task.name: self._record.plain()}


def read_method(path: Path) -> CommandMethod:
    """The method of a TOML file. Raises DataError where there is none, UsageError for what is wrong in it."""
    return CommandMethod(read_file(path), path.absolute().parent)


def decisive(file: MethodFile) -> dict[str, Any]:
    """What of a file decides the outcome, as plain data."""
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


def written(place: Place, command: TrainCommand) -> Listing:
    """What a command of training has written. Raises CommandFailed for a pattern that no file fits."""
    found: dict[str, int] = {}
    for pattern in command.writes:
        path = Path(filled(pattern, place.named())).relative_to(place.output)
        files = [place.output] if path == Path() else sorted(place.output.glob(str(path)))
        listing = listing_of(place.root, files)
        if not listing:
            raise CommandFailed(f"there is no {pattern}", f"{{output}} is {place.output}.")
        found |= listing
    return found


def _listing(wrote: Callable[[], Listing]) -> Listing | None:
    try:
        return wrote()
    except CommandFailed:
        return None


def _require_same(place: Place, command: TrainCommand, record: Record) -> None:
    listing = _listing(partial(written, place, command))
    if listing is None or digest_of(listing) != record.files:
        raise _gone(place, record)


def _gone(place: Place, record: Record) -> DataError:
    return DataError(
        f"what the command '{record.command}' of {place.file.title} has written is gone or changed",
        f"{place.output} should hold {record.file_count} files of it with {record.file_bytes} bytes.",
        f"Put the folder back; or remove {place.root} and the stored stages of this cell, so that it is trained anew.",
    )
