"""The TOML file of a method that is run as commands: its schema, and the checks of its values.

The dataclasses are the schema: a file may set every field, and has to set those without a default. See
docs/your_method.md.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from radiogs_core.errors import DataError, UsageError
from radiogs_core.plain_values import PlainReader
from radiogs_datasets.bounded_reading import read_toml
from radiogs_datasets.registry import LAYOUTS

from ..outputs.codes import CODES
from .placeholders import EVERYWHERE, IN_RESULTS, ITERATIONS, LISTS, ONE_LIGHT, check, placeholders

PRESETS = ("smoke", "tiny", "small", "paper")
"""Names of the presets."""
NAME = re.compile(r"[a-z0-9][a-z0-9._-]*")
"""Names of methods and commands."""
VARIABLE = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
"""Names of environment variables."""
LIGHT_SUFFIXES = (".hdr", ".exr")
"""Forms in which lights can be written for a command."""
MANUAL = "The fields of a method's file are described in docs/your_method.md."


@dataclass(frozen=True)
class PublicCode:
    """The location of a code on this machine; for a public code also its origin, optional with a ``folder``."""

    url: str = ""
    """Address of its repository."""
    commit: str = ""
    """Commit that the commands were written for."""
    licence: str = ""
    """Name of its licence."""
    variable: str = ""
    """Environment variable that holds the path of a checkout."""
    folder: str = ""
    """Path of the checkout if that variable is not set, relative to the method's file."""
    python: str = ""
    """Environment variable that holds the path of the code's Python; if it is not set, ``python`` is run."""


@dataclass(frozen=True)
class TrainCommand:
    """A command of training; each is a stage."""

    name: str
    """Name of the stage, of its log and of its record."""
    arguments: tuple[str, ...]
    """The program and its arguments, with placeholders."""
    writes: tuple[str, ...]
    """Glob patterns of files that the command has to write; for a folder, all files in it."""
    title: str = ""
    """Title of the stage in messages; empty: the method's title and ``name``."""
    resume: tuple[str, ...] = ()
    """Further arguments for continuing an interrupted run."""
    time_limit: float | None = None
    """Longest duration in seconds; None: no limit."""


@dataclass(frozen=True)
class RenderCommand:
    """The command that renders the test views under the light of the training views."""

    arguments: tuple[str, ...]
    """The program and its arguments, with placeholders."""
    maps: tuple[str, ...] = ("image",)
    """Maps that the command has to write for every test view."""
    time_limit: float | None = None
    """Longest duration in seconds; None: no limit."""


@dataclass(frozen=True)
class RelightCommand:
    """The command that renders the test views under other lights."""

    arguments: tuple[str, ...]
    """The program and its arguments, with placeholders."""
    all_lights: bool = False
    """Whether one run renders all lights of the scene; otherwise the command runs once for each light."""
    light_suffix: str = ".hdr"
    """Suffix of the files from which the code reads lights, one of LIGHT_SUFFIXES."""
    time_limit: float | None = None
    """Longest duration of a run in seconds; None: no limit."""


@dataclass(frozen=True)
class Iterations:
    """Iterations of a preset; 0 if no command has a placeholder for them."""

    iterations: int = 0
    """Iterations of the first stage."""
    further: int = 0
    """Iterations of the later stages."""


@dataclass(frozen=True)
class MethodFile:
    """The content of a method's file."""

    name: str
    """Name of the method in suites and on the command line."""
    title: str
    """Name of the method in tables."""
    reader: str
    """Layout of the method's results, a key of ``radiogs_baselines.outputs.codes.CODES``."""
    layouts: tuple[str, ...]
    """Layouts of scenes that the code can read."""
    code: PublicCode
    """The public code."""
    train: tuple[TrainCommand, ...]
    """Commands of training, in order."""
    render: RenderCommand | None = None
    """Command that renders the test views; None: training writes them."""
    relight: RelightCommand | None = None
    """Command that relights; None: the method cannot be relit."""
    results: str = "{output}"
    """Folder of the results, with placeholders."""
    working_folder: str = "{code}"
    """Folder in which commands run, with placeholders."""
    environment: Mapping[str, str] = field(default_factory=dict)
    """Environment variables of the commands, with placeholders."""
    settings: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Lists of arguments by name; ``{name}`` in a command's arguments is replaced by the list."""
    scenes: Mapping[str, Mapping[str, tuple[str, ...]]] = field(default_factory=dict)
    """Other values of settings, by a scene's name or layout, and by the setting's name."""
    presets: Mapping[str, Iterations] = field(default_factory=dict)
    """Iterations by preset."""
    resumes: bool = False
    """Whether an interrupted command continues from its files; if not, they are removed before it runs again."""
    traps: tuple[str, ...] = ()
    """Sentences on peculiarities of the code; they go with the results."""

    def iterations(self, preset: str) -> Iterations:
        """The iterations of a preset; zeros if the file does not name it."""
        return self.presets.get(preset, Iterations())

    @property
    def placeholders(self) -> set[str]:
        """Names of the placeholders in all texts, except settings."""
        texts = [self.results, self.working_folder, *self.environment.values()]
        for each in self.train:
            texts += [*each.arguments, *each.resume, *each.writes]
        for command in (self.render, self.relight):
            texts += command.arguments if command is not None else ()
        return {name for text in texts for name in placeholders(text)}


def read_file(path: Path) -> MethodFile:
    """Read a method's file. Raises DataError if it cannot be read, and UsageError if a value in it is wrong."""
    try:
        content = read_toml(path)
    except DataError as error:
        raise DataError(f"cannot read the method {path}", error.why, "Give the path of a method's file.") from error
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path} is not valid TOML: {error}", "", MANUAL) from error
    reader = PlainReader(str(path), MANUAL)
    file: MethodFile = reader.build(MethodFile, content, "")
    _Checks(reader, file).all()
    return file


class _Checks:
    """Checks of a method's file that types do not express."""

    def __init__(self, reader: PlainReader, file: MethodFile) -> None:
        self.reader, self.file = reader, file

    def all(self) -> None:
        """Raise UsageError for the first wrong value."""
        self._names()
        self._code()
        self._settings()
        self._texts()
        self._limits()
        self._presets()

    def _names(self) -> None:
        file, known, fail = self.file, self.reader.known, self.reader.fail
        if not NAME.fullmatch(file.name):
            fail("name", f"'{file.name}' is not a name", "A name has small letters, digits and the signs . _ -")
        known("reader", "reader", file.reader, CODES)
        for index, layout in enumerate(file.layouts):
            known(f"layouts[{index}]", "layout", layout, LAYOUTS)
        if not file.layouts:
            fail("layouts", "the list is empty", "It names the layouts of scenes that the code can read.")
        if not file.train:
            fail("train", "there is no command of training", "A method has at least one.")
        names = [each.name for each in file.train]
        for index, name in enumerate(names):
            if not NAME.fullmatch(name) or name == "render" or name.startswith("relight"):
                why = "It has small letters, digits and . _ - and is neither 'render' nor begins with 'relight'."
                fail(f"train[{index}].name", f"'{name}' is not a name of a command", why)
            if name in names[:index]:
                fail(f"train[{index}].name", f"two commands are called '{name}'", "Each has a name of its own.")

    def _code(self) -> None:
        code, fail = self.file.code, self.reader.fail
        if not code.variable and not code.folder:
            fail("code", "the location of the code is missing", "Set 'folder', or 'variable' to a variable's name.")
        if lacks := [name for name in ("url", "commit", "licence") if not (code.folder or getattr(code, name))]:
            fail("code", f"it lacks {', '.join(lacks)}", "They say where others get it; a 'folder' may lack them.")
        for where, name in (("code.variable", code.variable), ("code.python", code.python)):
            if name and not VARIABLE.fullmatch(name):
                fail(where, f"'{name}' is not a name of an environment variable")

    def _settings(self) -> None:
        settings, taken = self.file.settings, {**EVERYWHERE, **ONE_LIGHT, **LISTS}
        for name in settings:
            if name in taken or not name.isidentifier():
                why = "It is the name of another placeholder, or not an identifier."
                self.reader.fail(f"settings.{name}", f"'{name}' cannot be the name of a setting", why)
        for scene, values in self.file.scenes.items():
            for name in values:
                self.reader.known(f"scenes.{scene}", "setting", name, settings)

    def _texts(self) -> None:
        """Check that every placeholder has a value in its field."""
        file = self.file
        for index, each in enumerate(file.train):
            where = f"train[{index}]"
            self._list(f"{where}.arguments", each.arguments, LISTS)
            self._list(f"{where}.resume", each.resume)
            for number, text in enumerate(each.writes):
                self._result(f"{where}.writes[{number}]", text)
            if not each.writes:
                self.reader.fail(f"{where}.writes", "the list is empty", "It names the files that the command writes.")
            if each.resume and not file.resumes:
                self.reader.fail(f"{where}.resume", "it is used only with resumes = true")
        if file.render is not None:
            self._list("render.arguments", file.render.arguments)
        if file.relight is not None:
            known = EVERYWHERE if file.relight.all_lights else {**EVERYWHERE, **ONE_LIGHT}
            self._list("relight.arguments", file.relight.arguments, known=known)
        for name, value in file.environment.items():
            if not VARIABLE.fullmatch(name):
                self.reader.fail("environment", f"'{name}' is not a name of an environment variable")
            self._text(f"environment.{name}", value, EVERYWHERE)
        self._result("results", file.results)
        self._text("working_folder", file.working_folder, EVERYWHERE)

    def _list(
        self, where: str, texts: Sequence[str], lists: Iterable[str] = (), known: Mapping[str, str] = EVERYWHERE
    ) -> None:
        if where.endswith("arguments") and not texts:
            self.reader.fail(where, "the list is empty", "Its first entry is the program.")
        for index, text in enumerate(texts):
            if text not in [f"{{{name}}}" for name in (*lists, *self.file.settings)]:
                self._text(f"{where}[{index}]", text, known)

    def _result(self, where: str, text: str) -> None:
        self._text(where, text, IN_RESULTS)
        if not text.startswith("{output}") or ".." in Path(text).parts:
            self.reader.fail(where, f"'{text}' is not in {{output}}", "A run writes its results into its own folder.")

    def _text(self, where: str, text: str, known: Mapping[str, str]) -> None:
        check(text, known, f"{self.reader.source}: {where}")

    def _limits(self) -> None:
        file = self.file
        limits = {f"train[{index}].time_limit": each.time_limit for index, each in enumerate(file.train)}
        limits["render.time_limit"] = file.render.time_limit if file.render else None
        limits["relight.time_limit"] = file.relight.time_limit if file.relight else None
        for where, limit in limits.items():
            if limit is not None and limit <= 0:
                self.reader.fail(where, f"{limit:g} is not above zero", "It is a number of seconds.")
        if file.relight is not None:
            self.reader.known("relight.light_suffix", "suffix", file.relight.light_suffix, LIGHT_SUFFIXES)

    def _presets(self) -> None:
        file = self.file
        for name, each in file.presets.items():
            self.reader.known("presets", "preset", name, PRESETS)
            if min(each.iterations, each.further) < 0:
                self.reader.fail(f"presets.{name}", "a number of iterations is below zero")
        asked = file.placeholders & ITERATIONS
        needed = {"total": ("iterations", "further")}
        for name in sorted({part for each in asked for part in needed.get(each, (each,))}):
            for preset in PRESETS:
                if getattr(file.iterations(preset), name) < 1:
                    self.reader.fail(
                        f"presets.{preset}",
                        f"the field '{name}' is missing",
                        f"A command has a placeholder for it: {', '.join(f'{{{each}}}' for each in sorted(asked))}.",
                    )
