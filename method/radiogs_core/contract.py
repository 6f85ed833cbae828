"""What a method is: all that a harness knows of RadioGS, of a baseline, or of a stranger's code.

A method is trained in stages and then shown. ``Method.stages`` says which stages there are and what each depends on;
``StageSpec.begin`` makes one, which steps to its end and can be interrupted and resumed bit for bit. What the last
stage hands on is turned into a ``Trained`` model by ``Method.restore``; ``Trained.prepare`` makes it ready to be seen
under its own light or another one (relighting is preparing for another light), and ``Prepared.render`` gives the maps
of one camera.

Nothing here knows of surfels: a radiance field, or a program that is run as a command, fits as well.
"""

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, Generic, Literal, Protocol, TypeVar, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from .errors import ExplainedError, UsageError
from .plain_values import leaf_names, value_at, with_values
from .scene.camera import Camera
from .scene.light import EnvironmentMap
from .scene.scene import Scene

Maps = Mapping[str, Float[Tensor, "height width _"]]
"""Images of one camera by name, [height, width, channels]; ``MapKind`` says how each is to be read."""


VariantT = TypeVar("VariantT")
"""A method's own dataclass of what an ablation changes."""

BudgetT = TypeVar("BudgetT")
"""A method's own dataclass of how much work a run does (see ``Budget``)."""


class NotOffered(ExplainedError):
    """What a method cannot do by its nature, such as relighting; the metric reads n/a with this reason."""


class Budget(Protocol):
    """How much work a run may do: a frozen dataclass of numbers, whose ``name`` is that of its preset.

    Whole numbers are what rows of a suite may multiply (``scaled``).
    """

    @property
    def name(self) -> str:
        """The preset's name, such as ``tiny``."""


@dataclass(frozen=True)
class Run(Generic[VariantT, BudgetT]):
    """What a method is run on."""

    scene: Scene
    """The scene; ``Scene.train`` are the views to learn from."""
    variant: VariantT
    """An instance of ``Method.variant``."""
    budget: BudgetT
    """One of ``Method.presets``, or a multiple of it (``scaled``)."""
    seed: int
    """Seeds every random generator of the run."""
    device: torch.device
    """The device that tensors live on."""
    workspace: Path | None = None
    """A folder for methods that keep files while they train; it outlives an interruption."""


@runtime_checkable
class Stage(Protocol):
    """A resumable optimisation: restoring a state and stepping on gives what stepping on would have given.

    A stage that waits for something else may return from ``step`` with ``iteration`` as it was, at least twice a
    second, so that a request to stop is heard. One that holds more than memory may be ``capabilities.Closing``.
    """

    iteration: int
    """Steps taken so far."""
    iterations: int
    """Steps of the whole stage."""

    def step(self) -> Mapping[str, float]:
        """Take one step; returns the weighted losses by name. Raises NumericalFailure for a non-finite value."""

    def state(self) -> dict[str, Any]:
        """Tensors and plain values from which to continue bit for bit."""

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a state."""

    def product(self) -> dict[str, Any]:
        """Tensors and plain values that the next stage begins from; of the last stage, what ``Method.restore`` takes.

        May be asked for at any step: a model that is scored along the way is restored from it.
        """


@dataclass(frozen=True)
class StageSpec(Generic[VariantT, BudgetT]):
    """One stage of a method: its name, its dependencies, and how it begins."""

    name: str
    """A short name, such as ``initialise``; results list seconds and work under it."""
    title: str
    """The name in progress bars."""
    steps: int
    """Number of steps."""
    owner: str
    """The method that the stage belongs to; methods that share a stage name the same owner and train it once."""
    reads: Mapping[str, Any]
    """The fields of variant and budget that decide the stage's outcome, with their values."""
    sources: tuple[str, ...]
    """Names of modules whose files, with those of all modules that they import, decide the stage's outcome."""
    begin: Callable[[Run[VariantT, BudgetT], Mapping[str, Any]], Stage]
    """Makes the stage from a run and the product of the stage before it (empty for the first one)."""
    compiles: bool = False
    """Whether the first step compiles kernels; one step is then taken beforehand and charged to no cell."""
    keeps_files: bool = False
    """Whether the outcome lies in ``Run.workspace``; later stages then run on the same machine."""
    uses_surfaces: bool = False
    """Whether the stage reads the scene's true surfaces; the modules that compute those then decide its outcome too."""


@dataclass(frozen=True)
class MapKind:
    """How the values of a map are to be read."""

    colour: Literal["display", "linear", "data"]
    """Display sRGB in [0, 1]; linear radiance or albedo; or data (normals, depth, roughness, coverage)."""
    alpha: Literal["multiplied", "straight"] = "multiplied"
    """Multiplied by coverage, that is, composited on black; or straight."""


@runtime_checkable
class Prepared(Protocol):
    """A trained model under one light, ready to be seen from any camera."""

    @property
    def offers(self) -> Mapping[str, MapKind]:
        """Every map that it can render, and how each is to be read.

        image: what the camera sees. alpha: coverage, one channel. albedo: diffuse, linear. normal: unit, in the world.
        roughness: perceptual (alpha_GGX = r^2). depth: z-depth, world units. direct, indirect: outgoing radiance after
        one surface, and after more. incident: mean indirect radiance that arrives over the hemisphere.
        """

    @property
    def default(self) -> frozenset[str]:
        """Maps that every rendering has; the others cost extra and are asked for by name."""

    @property
    def timed(self) -> bool:
        """Whether the seconds of a rendering mean anything (not where images are read from files)."""

    def render(self, camera: Camera, *further: str) -> Maps:
        """The maps of one view: the default ones and those of ``further`` that it offers."""


@runtime_checkable
class Trained(Protocol):
    """What training has found."""

    @property
    def light(self) -> EnvironmentMap | None:
        """The light of the training views as it was recovered, linear; None for a method that finds none."""

    def facts(self) -> dict[str, Any]:
        """Plain values that go into the result, such as the number of surfels; ``metrics`` among them maps names such
        as ``plan/bound`` to values that stand in tables like any other metric, and ``labels`` names to sentences that
        stand below tables: in what a method differs from the published one of its name."""

    def export(self, folder: Path) -> list[Path]:
        """Write the model for other programs, without its light; returns the files written. Raises OSError."""

    def prepare(
        self,
        light: EnvironmentMap | None = None,
        albedo_scale: Float[Tensor, "3"] | None = None,
        after_step: Callable[[], None] = lambda: None,
    ) -> Prepared:
        """Make ready to be seen under its own light (None) or relit by another one.

        albedo_scale: factor for each channel of the recovered albedo, which is known up to one. after_step: called
        between the steps of a long preparation; it may raise to end it. Raises DataError for a light that is not
        finite, NotOffered where the method cannot be relit.
        """


@runtime_checkable
class Method(Protocol[VariantT, BudgetT]):
    """A method of inverse rendering, generic in its dataclasses of variants and budgets.

    A method that says ``class Mine(Method[MyVariant, MyBudget])`` has its fields checked by the type checker; the
    harness takes any object with these members.
    """

    @property
    def name(self) -> str:
        """As suites and ``--method`` call it: lower case, such as ``radiogs``."""

    @property
    def title(self) -> str:
        """As tables print it, such as ``RadioGS``."""

    @property
    def variant(self) -> type[VariantT]:
        """A frozen dataclass: every field that an ablation may turn, with the full method as default."""

    @property
    def presets(self) -> Mapping[str, BudgetT]:
        """Budgets by name: smoke, tiny, small, paper."""

    @property
    def sources(self) -> tuple[str, ...]:
        """Modules that turn a trained model into maps; they and what they import decide its metrics."""

    def stages(self, variant: VariantT, budget: BudgetT) -> Sequence[StageSpec[VariantT, BudgetT]]:
        """The stages of training, in order; at least one."""

    def restore(self, run: Run[VariantT, BudgetT], tensors: Mapping[str, Any]) -> Trained:
        """The model from the product of the last stage."""


def values_of(of: object, *names: str) -> dict[str, Any]:
    """Some fields of a variant or budget by name, for ``StageSpec.reads``."""
    return {name: _plain(getattr(of, name)) for name in names}


def values_but(of: object, *names: str) -> dict[str, Any]:
    """All fields of a variant or budget but these, for ``StageSpec.reads``."""
    chosen = (field.name for field in fields(of) if field.name not in names)  # type: ignore[arg-type]
    return values_of(of, *chosen)


def _plain(value: Any) -> Any:
    return asdict(value) if is_dataclass(value) and not isinstance(value, type) else value


def whole_numbers(budget: Any) -> tuple[str, ...]:
    """The fields of a budget that rows of a suite may multiply; those of a nested half by dotted names."""
    return tuple(name for name in leaf_names(budget) if type(value_at(budget, name)) is int)


LARGEST_COUNT = 2**31 - 1


def scaled(budget: Any, factors: Mapping[str, float]) -> Any:
    """The budget with some of its whole numbers multiplied; its name says which.

    Names of nested fields are dotted, such as ``geometry.steps``. A budget that has renamed fields lists them as
    ``renamed``, from the old name to the new one; the old one works with a warning. Raises UsageError for a field that
    is none of its whole numbers, and where less than one is left.
    """
    if not factors:
        return budget
    factors = {current_name(budget, name): factor for name, factor in factors.items()}
    whole = whole_numbers(budget)
    for name in factors:
        if name not in whole:
            raise UsageError(
                f"preset '{budget.name}' has no whole number '{name}'", f"What can be multiplied: {', '.join(whole)}."
            )
    if not all(math.isfinite(factor) for factor in factors.values()):
        raise UsageError(f"preset '{budget.name}' is multiplied by what is not finite", f"{dict(factors)}")
    changes = {name: round(value_at(budget, name) * factor) for name, factor in factors.items()}
    for name, value in changes.items():
        if value < 1:
            raise UsageError(f"preset '{budget.name}' is too small: {name} times {factors[name]:g} is less than one")
        if value > LARGEST_COUNT:
            raise UsageError(
                f"preset '{budget.name}' is too large: {name} would be {value:g}", "Kernels count to 2^31."
            )
    marks = ", ".join(f"{name} x {factor:g}" for name, factor in factors.items() if factor != 1)
    return with_values(budget, {"name": f"{budget.name}, {marks}" if marks else budget.name, **changes})


def current_name(budget: Any, name: str) -> str:
    """The name that a field of a budget has now; a former one gives a warning."""
    renamed: Mapping[str, str] = getattr(budget, "renamed", {})
    if name not in renamed:
        return name
    warnings.warn(f"'{name}' of a budget is called '{renamed[name]}' now", FutureWarning, stacklevel=3)
    return renamed[name]
