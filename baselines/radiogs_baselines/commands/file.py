"""A method as a TOML file: the commands of a public code, and what one must know of them (docs/methods_as_commands.md).

The dataclasses are the schema: every field may stand in a file, those without a default must.
"""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from radiogs_core.errors import DataError, UsageError
from radiogs_core.plain_values import PlainReader
from radiogs_datasets.bounded_reading import TABLE_LIMIT, read_bytes
from radiogs_datasets.registry import LAYOUTS

from ..outputs.codes import CODES
from .placeholders import EVERYWHERE, IN_RESULTS, ITERATIONS, LISTS, ONE_LIGHT, check, placeholders

PRESETS = ("smoke", "tiny", "small", "paper")
NAME = re.compile(r"[a-z0-9][a-z0-9._-]*")
VARIABLE = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
LIGHT_SUFFIXES = (".hdr", ".exr")
MANUAL = "What a method's file may say: docs/methods_as_commands.md"


@dataclass(frozen=True)
class PublicCode:
    """Where a public code comes from, and where it is on this machine.

    ``commit`` is the one that the commands were written for. ``variable`` names the environment variable that holds
    the path of a checkout; ``folder`` is its path where the variable is not set, from the file's folder. ``python``
    names the variable that holds the path of its environment's interpreter; where that is not set, it is ``python``.
    """

    url: str
    commit: str
    licence: str
    variable: str = ""
    folder: str = ""
    python: str = ""


@dataclass(frozen=True)
class TrainCommand:
    """One command of training; each is a stage.

    ``writes`` are patterns (as of ``glob``) of the files without which it has not ended well; a folder stands for all
    that is in it. ``resume`` are arguments for going on with a run that was cut short. ``time_limit`` is in seconds.
    """

    name: str
    arguments: tuple[str, ...]
    writes: tuple[str, ...]
    title: str = ""
    resume: tuple[str, ...] = ()
    time_limit: float | None = None


@dataclass(frozen=True)
class RenderCommand:
    """Rendering the test views under the light of the training views; ``maps`` must be there after it."""

    arguments: tuple[str, ...]
    maps: tuple[str, ...] = ("image",)
    time_limit: float | None = None


@dataclass(frozen=True)
class RelightCommand:
    """Rendering the test views under another light: one a run, or ``all_lights`` of the scene at once.

    ``light_suffix`` is the kind of file that the code reads lights from.
    """

    arguments: tuple[str, ...]
    all_lights: bool = False
    light_suffix: str = ".hdr"
    time_limit: float | None = None


@dataclass(frozen=True)
class Iterations:
    """Iterations of a preset: of the first stage, and of what follows; 0 where no command asks."""

    iterations: int = 0
    further: int = 0


@dataclass(frozen=True)
class MethodFile:
    """A method that is run as commands.

    ``reader`` is the layout of its results (``radiogs_baselines.outputs``), ``results`` the folder that they are in.
    ``layouts`` are those of scenes that the code can read. Without ``render``, training writes the test views itself;
    without ``relight``, nothing is relit. ``settings`` are lists of arguments by name, to stand in those of commands
    as ``{name}``; ``scenes`` gives other values for scenes of some names. ``resumes``: a command that was cut short is
    run again in the folder as it is; otherwise what it wrote is removed first. ``traps`` are sentences on what one
    must know of this code.
    """

    name: str
    title: str
    reader: str
    layouts: tuple[str, ...]
    code: PublicCode
    train: tuple[TrainCommand, ...]
    render: RenderCommand | None = None
    relight: RelightCommand | None = None
    results: str = "{output}"
    working_folder: str = "{code}"
    environment: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    scenes: Mapping[str, Mapping[str, tuple[str, ...]]] = field(default_factory=dict)
    presets: Mapping[str, Iterations] = field(default_factory=dict)
    resumes: bool = False
    traps: tuple[str, ...] = ()

    def iterations(self, preset: str) -> Iterations:
        """The iterations of a preset."""
        return self.presets.get(preset, Iterations())

    def settings_for(self, scene: str) -> Mapping[str, tuple[str, ...]]:
        """The settings for a scene of that name."""
        return {**self.settings, **self.scenes.get(scene, {})}

    @property
    def reads_lights(self) -> bool:
        """Whether a command reads the scene's lights from the files that are made for it."""
        names = {name for text in self.texts for name in placeholders(text)}
        return not names.isdisjoint({"lights", "light_file"})

    @property
    def texts(self) -> list[str]:
        """Every text that may hold placeholders, but settings."""
        texts = [self.results, self.working_folder, *self.environment.values()]
        for each in self.train:
            texts += [*each.arguments, *each.resume, *each.writes]
        for command in (self.render, self.relight):
            texts += command.arguments if command is not None else ()
        return texts


def read_file(path: Path) -> MethodFile:
    """The method of a file. Raises DataError where there is none, UsageError for what is wrong in it."""
    try:
        content = tomllib.loads(read_bytes(path, TABLE_LIMIT).decode())
    except DataError as error:
        raise DataError(f"cannot read the method {path}", error.why, "Name a method's file.") from error
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path} is no TOML: {error}", "", MANUAL) from error
    reader = PlainReader(str(path), MANUAL)
    file: MethodFile = reader.build(MethodFile, content, "")
    _Checks(reader, file).all()
    return file


class _Checks:
    """What types do not say."""

    def __init__(self, reader: PlainReader, file: MethodFile) -> None:
        self.reader, self.file = reader, file

    def all(self) -> None:
        """Raise UsageError for the first thing that is wrong."""
        self._names()
        self._code()
        self._settings()
        self._texts()
        self._limits()
        self._presets()

    def _names(self) -> None:
        file, known, fail = self.file, self.reader.known, self.reader.fail
        if not NAME.fullmatch(file.name):
            fail("name", f"'{file.name}' is no name", "It is of small letters, digits and the signs . _ -")
        known("reader", "reader", file.reader, CODES)
        for place, layout in enumerate(file.layouts):
            known(f"layouts[{place}]", "layout", layout, LAYOUTS)
        if not file.layouts:
            fail("layouts", "the list is empty", "It says which scenes the code can read.")
        if not file.train:
            fail("train", "there is no command of training", "A method has at least one.")
        names = [each.name for each in file.train]
        for place, name in enumerate(names):
            if not NAME.fullmatch(name) or name == "render" or name.startswith("relight"):
                fail(f"train[{place}].name", f"'{name}' is no name of a command", "Logs and records are named by it.")
            if name in names[:place]:
                fail(f"train[{place}].name", f"two commands are called '{name}'", "Each has a name of its own.")

    def _code(self) -> None:
        code, fail = self.file.code, self.reader.fail
        if not code.variable and not code.folder:
            fail("code", "nothing says where the code is", "Give its folder, or the variable that holds it.")
        for where, name in (("code.variable", code.variable), ("code.python", code.python)):
            if name and not VARIABLE.fullmatch(name):
                fail(where, f"'{name}' is no name of an environment variable")

    def _settings(self) -> None:
        settings, taken = self.file.settings, {**EVERYWHERE, **ONE_LIGHT, **LISTS}
        for name in settings:
            if name in taken or not name.isidentifier():
                why = "It is a placeholder of its own, or no name at all."
                self.reader.fail(f"settings.{name}", f"'{name}' cannot be the name of a setting", why)
        for scene, values in self.file.scenes.items():
            for name in values:
                self.reader.known(f"scenes.{scene}", "setting", name, settings)

    def _texts(self) -> None:
        """Every placeholder stands where it means something."""
        file = self.file
        for place, each in enumerate(file.train):
            where = f"train[{place}]"
            self._list(f"{where}.arguments", each.arguments, LISTS)
            self._list(f"{where}.resume", each.resume)
            for number, text in enumerate(each.writes):
                self._result(f"{where}.writes[{number}]", text)
            if not each.writes:
                self.reader.fail(f"{where}.writes", "the list is empty", "It says what the next command needs.")
            if each.resume and not file.resumes:
                self.reader.fail(f"{where}.resume", "the method does not say resumes = true")
        if file.render is not None:
            self._list("render.arguments", file.render.arguments)
        if file.relight is not None:
            light = {} if file.relight.all_lights else ONE_LIGHT
            self._list("relight.arguments", file.relight.arguments, further=light)
        for name, value in file.environment.items():
            if not VARIABLE.fullmatch(name):
                self.reader.fail("environment", f"'{name}' is no name of an environment variable")
            self._text(f"environment.{name}", value, EVERYWHERE)
        self._result("results", file.results)
        self._text("working_folder", file.working_folder, EVERYWHERE)

    def _list(
        self,
        where: str,
        texts: tuple[str, ...],
        lists: Mapping[str, str] | None = None,
        further: Mapping[str, str] | None = None,
    ) -> None:
        if where.endswith("arguments") and not texts:
            self.reader.fail(where, "the list is empty", "Its first is the program.")
        for place, text in enumerate(texts):
            if text not in [f"{{{name}}}" for name in (*(lists or ()), *self.file.settings)]:
                self._text(f"{where}[{place}]", text, {**EVERYWHERE, **(further or {})})

    def _result(self, where: str, text: str) -> None:
        self._text(where, text, IN_RESULTS)
        if not text.startswith("{output}") or ".." in Path(text).parts:
            self.reader.fail(where, f"'{text}' is not in {{output}}", "What a run makes is kept in one place, its own.")

    def _text(self, where: str, text: str, known: Mapping[str, str]) -> None:
        check(text, known, f"{self.reader.source}: {where}")

    def _limits(self) -> None:
        file = self.file
        limits = {f"train[{place}].time_limit": each.time_limit for place, each in enumerate(file.train)}
        limits["render.time_limit"] = file.render.time_limit if file.render else None
        limits["relight.time_limit"] = file.relight.time_limit if file.relight else None
        for where, limit in limits.items():
            if limit is not None and limit <= 0:
                self.reader.fail(where, f"{limit:g} is not above zero", "It is in seconds.")
        if file.relight is not None:
            self.reader.known("relight.light_suffix", "suffix", file.relight.light_suffix, LIGHT_SUFFIXES)

    def _presets(self) -> None:
        file = self.file
        for name, each in file.presets.items():
            self.reader.known("presets", "preset", name, PRESETS)
            if min(each.iterations, each.further) < 0:
                self.reader.fail(f"presets.{name}", "a number of iterations is below zero")
        asked = {name for text in file.texts for name in placeholders(text)} & ITERATIONS
        needed = {"total": ("iterations", "further")}
        for name in sorted({part for each in asked for part in needed.get(each, (each,))}):
            for preset in PRESETS:
                if getattr(file.iterations(preset), name) < 1:
                    self.reader.fail(
                        f"presets.{preset}",
                        f"the field '{name}' is missing",
                        f"A command asks for it ({', '.join(f'{{{each}}}' for each in sorted(asked))}).",
                    )
