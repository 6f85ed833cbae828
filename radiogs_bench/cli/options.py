"""Options that several commands have, as types of their parameters."""

from dataclasses import dataclass
from glob import escape, glob
from itertools import chain
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter

from radiogs_core.errors import UsageError
from radiogs_datasets.options import SceneOptions

from .values import effects, from_every_text, from_text, method_file, positive, setting

if TYPE_CHECKING:
    import torch
    from cyclopts.completion import CompletionContext


METHOD = "radiogs"
"""The method that is trained and probed where none is named."""


def offering(*places: str) -> Parameter:
    """An option for which a shell offers names of ``places`` (module:container, or function), and paths."""

    def complete(context: "CompletionContext") -> list[str]:
        before, comma, last = context.incomplete.rpartition(",")
        known = [found() if callable(found) else found for found in map(resolve_name, places)]
        return [f"{before}{comma}{name}" for name in (*chain(*known), *glob(f"{escape(last)}*"))]

    return Parameter(completer=complete)


SUITES, SCENES = "radiogs_bench.suites.registry:SUITES", "radiogs_datasets:known_names"
METHODS = "radiogs_bench.installed_methods:method_names"

Count = Annotated[int, Parameter(metavar="N"), from_text(positive)]
MaybeCount = Annotated[tuple[Count, ...] | None, Parameter(metavar="N", consume_multiple=(0, 1))]
"""An option whose number may be left out: it is then the empty tuple."""
Names = Annotated[tuple[str, ...], Parameter(metavar="A,B")]
SceneName = Annotated[str, offering(SCENES)]
SceneNames = Annotated[Names, offering(SCENES)]
SuiteName = Annotated[str, offering(SUITES)]
SuiteOrScene = Annotated[str, offering(SUITES, SCENES)]
MethodName = Annotated[str, offering(METHODS)]
MethodNames = Annotated[Names, offering(METHODS)]
DataSetName = Annotated[str, offering("radiogs_bench.fetching.catalogue:DATA_SETS")]
CodeName = Annotated[str, offering("radiogs_baselines.outputs.codes:CODES")]
ProtocolName = Annotated[str, offering("radiogs_bench.scoring.metrics.protocols:PROTOCOLS")]

PresetName = Literal["smoke", "tiny", "small", "paper"] | str
"""A preset that every method has, or another one of the method."""

EffectsChoice = Annotated[str | tuple[str, ...], from_text(effects), Parameter(metavar="all|auto|LIST")]
Json = Annotated[bool, Parameter(name="--json")]
Device = Literal["cpu", "cuda"]
Trust = Annotated[
    tuple[str, ...],
    from_every_text(method_file),
    Parameter(
        metavar="FILE",
        help="Print and run the commands of this method's file, which the model or the suite names. This option may be"
        " repeated.",
    ),
]

OPTIONS = Group("Options", sort_key=0)
OPENING = Group("How scenes are opened", sort_key=1)
Opened = Annotated[SceneOptions, Parameter(name="*", group=OPENING)]
Data = Annotated[
    Path | None,
    Parameter(
        group=OPENING, help="Look for scenes in this folder of data sets (default: the variable RADIOGS_BENCH_DATA)."
    ),
]


@Parameter(name="*")
@dataclass(frozen=True)
class Computing:
    """Where a command computes."""

    device: Device = "cpu"
    """Compute on this device."""
    threads: Count | None = None
    """Use N CPU threads (default: as many as there are cores)."""

    def use(self) -> "torch.device":
        """Set the number of CPU threads; returns the device. Raises UsageError if the device is missing."""
        from ..device import use

        return use(self.device, self.threads)


@Parameter(name="*")
@dataclass(frozen=True)
class Opening(Computing):
    """How a command opens a trained model."""

    trust: Trust = ()
    data: Data = None


@Parameter(name="*")
@dataclass(frozen=True)
class Changes:
    """How a command changes the settings of a method."""

    recipe: str = ""
    """Take all settings from this recipe of the method: RadioGS has printed (the paper's values), released (the
    published code's) and recommended, its default."""
    effects: EffectsChoice = "all"
    """Simulate all effects, only the needed ones (auto), or the ones in this list."""
    settings: Annotated[
        tuple[tuple[str, Any], ...], from_every_text(setting), Parameter(name="--set", metavar="FIELD=VALUE")
    ] = ()
    """Set a field of the method's variant or budget, by its dotted name as `methods NAME` lists it, such as
    materials.rates.light=0.01. This option may be repeated."""

    def fields(self) -> dict[str, Any]:
        """The fields that ``--set`` changes, by dotted names. Raises UsageError for one that is set twice."""
        names = ["effects" if name == "variant.effects" else name for name, _ in self.settings]
        if self.effects != "all":
            names.append("effects")
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise UsageError(
                f"'{twice[0]}' is set twice", "", "Give every field once (--effects sets the field 'effects')."
            )
        return dict(self.settings)


ON_CPU, AS_TRAINED, UNCHANGED = Computing(), Opening(), Changes()


def no_effects(method: str) -> UsageError:
    """The error for a choice of effects of a method that has none."""
    return UsageError(f"{method} has no choice of effects", "", "Leave --effects out.")
