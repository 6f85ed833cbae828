"""The contract of a method: everything that the harness knows of RadioGS, of a baseline, or of another package's code.

A method is trained in stages and then rendered. ``Method.stages`` lists the stages with their dependencies;
``StageSpec.begin`` makes a stage, which steps to its end and can be interrupted and resumed bit for bit.
``Method.restore`` makes a ``Trained`` model from the product of the last stage; ``Trained.prepare`` makes it ready for
rendering under its own light or another one (relighting is preparing for another light), and ``Prepared.render``
returns the maps of one camera.

The contract does not mention surfels: a radiance field, or a program that runs as a command, fits as well.
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
"""Images of one camera by name, [height, width, channels]; ``MapKind`` gives the meaning of their values."""


VariantT = TypeVar("VariantT")
"""A method's own dataclass with the settings that an ablation may change."""

BudgetT = TypeVar("BudgetT")
"""A method's own dataclass with the amount of work of a run (see ``Budget``)."""


class NotOffered(ExplainedError):
    """The method does not support the request, such as relighting; tables show n/a with this reason."""


class Budget(Protocol):
    """The amount of work of a run: a frozen dataclass of numbers, with the name of its preset as ``name``.

    Rows of a suite may multiply its whole numbers (``scaled``).
    """

    @property
    def name(self) -> str:
        """The preset's name, such as ``tiny``."""


@dataclass(frozen=True)
class Run(Generic[VariantT, BudgetT]):
    """The inputs of a run: scene, settings, seed and device."""

    scene: Scene
    """The scene; ``Scene.train`` has the training views."""
    variant: VariantT
    """An instance of ``Method.variant``."""
    budget: BudgetT
    """One of ``Method.presets``, or a multiple of it (``scaled``)."""
    seed: int
    """Seeds every random generator of the run."""
    device: torch.device
    """The device of all tensors."""
    workspace: Path | None = None
    """A folder for methods that write files while they train; an interruption does not delete it."""


@runtime_checkable
class Stage(Protocol):
    """A resumable optimisation: steps after ``restore`` give the same results as steps without an interruption.

    A stage that waits for another process may return from ``step`` with an unchanged ``iteration``, at least twice a
    second, so that the harness can stop it, but not immediately: many immediate returns in a row end its cell. A stage
    with resources besides memory may be ``capabilities.Closing``.
    """

    iteration: int
    """Steps taken so far."""
    iterations: int
    """Steps of the whole stage."""

    def step(self) -> Mapping[str, float]:
        """Take one step; returns the weighted losses by name. Raises NumericalFailure for a non-finite value."""

    def state(self) -> dict[str, Any]:
        """Tensors and plain values from which ``restore`` continues bit for bit."""

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a state that ``state`` returned."""

    def product(self) -> dict[str, Any]:
        """Tensors and plain values that the next stage begins from, or, after the last stage, ``Method.restore``.

        The harness may call it at any step, to score a model during training.
        """


@dataclass(frozen=True)
class SharedStart(Generic[VariantT, BudgetT]):
    """The part of a stage's beginning that variants share: a harness makes it once and stores it.

    ``begin(run, make(run, before))`` is the stage that ``StageSpec.begin(run, before)`` makes, to the last bit, whether
    the product of ``make`` was made in this process or read from a file.
    """

    reads: Mapping[str, Any]
    """The fields of variant and budget that decide the product, with their values."""
    sources: tuple[str, ...]
    """Names of modules that decide the product, together with all modules that they import."""
    make: Callable[[Run[VariantT, BudgetT], Mapping[str, Any]], dict[str, Any]]
    """Makes the product, tensors and plain values, from a run and the product of the previous stage.

    If it draws random numbers, the state of its generator is part of the product: the stage draws on from there.
    """
    begin: Callable[[Run[VariantT, BudgetT], Mapping[str, Any]], Stage]
    """Makes the stage from a run and the product of ``make``."""
    uses_surfaces: bool = False
    """Whether ``make`` reads the scene's true surfaces (as in ``StageSpec``)."""


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
    """Names of modules that decide the stage's outcome, together with all modules that they import."""
    begin: Callable[[Run[VariantT, BudgetT], Mapping[str, Any]], Stage]
    """Makes the stage from a run and the product of the previous stage (empty for the first one)."""
    compiles: bool = False
    """Whether the first step compiles kernels; if so, an untimed step runs before the timed steps."""
    keeps_files: bool = False
    """Whether the outcome consists of files in ``Run.workspace``; if so, later stages run on the same machine."""
    uses_surfaces: bool = False
    """Whether the stage reads the scene's true surfaces; if so, the modules that compute them count as sources too."""
    start: SharedStart[VariantT, BudgetT] | None = None
    """The part of the beginning that runs of other variants share, if there is one."""


@dataclass(frozen=True)
class MapKind:
    """The meaning of a map's values."""

    colour: Literal["display", "linear", "data"]
    """Display sRGB in [0, 1]; linear radiance or albedo; or data (normals, depth, roughness, coverage)."""
    alpha: Literal["multiplied", "straight"] = "multiplied"
    """Multiplied by coverage, that is, composited on black; or straight."""


STANDARD_MAPS: Mapping[str, MapKind] = {
    "image": MapKind("display"),
    "alpha": MapKind("data"),
    "direct": MapKind("linear"),
    "indirect": MapKind("linear"),
    "albedo": MapKind("linear"),
    "roughness": MapKind("data"),
    "normal": MapKind("data"),
    "depth": MapKind("data"),
}
"""Maps of every rendering, all composited on black."""


@runtime_checkable
class Prepared(Protocol):
    """A trained model under one light, ready for rendering from any camera."""

    @property
    def offers(self) -> Mapping[str, MapKind]:
        """Every map that can be rendered, with its kind.

        image: the camera's image. alpha: coverage, one channel. albedo: diffuse, linear. normal: unit, in the world.
        roughness: perceptual (alpha_GGX = r^2). depth: z-depth, world units. direct: outgoing radiance of light that
        was scattered once; indirect: of light that was scattered more often. incident: mean over the hemisphere of the
        indirect radiance that arrives.
        """

    @property
    def default(self) -> frozenset[str]:
        """Names of the maps in every rendering. The others cost extra and are rendered on request."""

    @property
    def timed(self) -> bool:
        """Whether the time of a rendering is worth measuring; False if images are read from files."""

    def render(self, camera: Camera, *further: str) -> Maps:
        """The maps of one view: the default ones, and those named in ``further`` that the model offers."""


@runtime_checkable
class Trained(Protocol):
    """The result of training."""

    @property
    def light(self) -> EnvironmentMap | None:
        """The recovered light of the training views, linear RGB; None for a method that does not recover it."""

    def facts(self) -> dict[str, Any]:
        """Plain values for the stored result, such as the number of surfels.

        ``metrics``: values by name, such as ``plan/bound``, which tables show like any other metric. ``labels``:
        sentences by name, which tables show as notes: how the method differs from the published one of its name.
        """

    def export(self, folder: Path) -> list[Path]:
        """Write the model for other programs, without its light; returns the paths of the files. Raises OSError."""

    def prepare(
        self,
        light: EnvironmentMap | None = None,
        albedo_scale: Float[Tensor, "3"] | None = None,
        after_step: Callable[[], None] = lambda: None,
    ) -> Prepared:
        """Make the model ready for rendering under its own light (None) or another one.

        albedo_scale: factor for each channel of the recovered albedo, which images determine only up to such a factor.
        after_step: called between the steps of a long preparation; it may raise to end it. Raises DataError for a
        light that is not finite, NotOffered if the method does not support relighting.
        """


@runtime_checkable
class Method(Protocol[VariantT, BudgetT]):
    """A method of inverse rendering, generic in its dataclasses of variants and budgets.

    The type checker checks the fields of a method declared as ``class Mine(Method[MyVariant, MyBudget])``; the harness
    takes any object with these members.
    """

    @property
    def name(self) -> str:
        """Name in suites and in ``--method``: lower case, such as ``radiogs``."""

    @property
    def title(self) -> str:
        """Name in tables, such as ``RadioGS``."""

    @property
    def variant(self) -> type[VariantT]:
        """A frozen dataclass with every setting that an ablation may change; its defaults are the full method."""

    @property
    def presets(self) -> Mapping[str, BudgetT]:
        """Budgets by name: smoke, tiny, small, paper."""

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of the modules that render a trained model; they and their imports decide its metrics."""

    def stages(self, variant: VariantT, budget: BudgetT) -> Sequence[StageSpec[VariantT, BudgetT]]:
        """The stages of training, in order; at least one."""

    def restore(self, run: Run[VariantT, BudgetT], tensors: Mapping[str, Any]) -> Trained:
        """The model from the product of the last stage."""


def values_of(of: object, *names: str) -> dict[str, Any]:
    """The named fields of a variant or budget, with their plain values, for ``StageSpec.reads``."""
    return {name: _plain(getattr(of, name)) for name in names}


def values_but(of: object, *names: str) -> dict[str, Any]:
    """All fields of a variant or budget except the named ones, for ``StageSpec.reads``."""
    chosen = (field.name for field in fields(of) if field.name not in names)  # type: ignore[arg-type]
    return values_of(of, *chosen)


def _plain(value: Any) -> Any:
    return asdict(value) if is_dataclass(value) and not isinstance(value, type) else value


def whole_numbers(budget: Any) -> tuple[str, ...]:
    """Names of a budget's fields that rows of a suite may multiply; fields of nested dataclasses by dotted names."""
    return tuple(name for name in leaf_names(budget) if type(value_at(budget, name)) is int)


LARGEST_COUNT = 2**31 - 1
"""Largest whole number of a scaled budget: kernels index with 32-bit integers."""


def scaled(budget: Any, factors: Mapping[str, float]) -> Any:
    """The budget with some of its whole numbers multiplied by ``factors``; its new name lists them.

    Names of nested fields are dotted, such as ``geometry.steps``. A budget with renamed fields lists them in
    ``renamed``, from the old name to the new one; an old name works and gives a warning. Raises UsageError for a name
    that is not a whole number of the budget, for a factor that is not finite, and for a product below 1 or above
    LARGEST_COUNT.
    """
    if not factors:
        return budget
    factors = {current_name(budget, name): factor for name, factor in factors.items()}
    whole = whole_numbers(budget)
    for name in factors:
        if name not in whole:
            raise UsageError(
                f"preset '{budget.name}' has no whole number '{name}'", f"It can multiply: {', '.join(whole)}."
            )
    if not all(math.isfinite(factor) for factor in factors.values()):
        raise UsageError(
            f"preset '{budget.name}' is multiplied by a number that is not finite: {dict(factors)}",
            remedy="Use finite factors.",
        )
    changes = {name: round(value_at(budget, name) * factor) for name, factor in factors.items()}
    for name, value in changes.items():
        if value < 1:
            raise UsageError(
                f"preset '{budget.name}' is too small: {name} times {factors[name]:g} is less than one",
                remedy="Use a larger factor or a larger preset.",
            )
        if value > LARGEST_COUNT:
            raise UsageError(
                f"preset '{budget.name}' is too large: {name} would be {value:g}",
                "Kernels index with 32-bit integers, up to 2^31 - 1.",
                "Use a smaller factor.",
            )
    marks = ", ".join(f"{name} x {factor:g}" for name, factor in factors.items() if factor != 1)
    return with_values(budget, {"name": f"{budget.name}, {marks}" if marks else budget.name, **changes})


def current_name(budget: Any, name: str) -> str:
    """The present name of a budget's field; a former name gives a FutureWarning."""
    renamed: Mapping[str, str] = getattr(budget, "renamed", {})
    if name not in renamed:
        return name
    warnings.warn(f"'{name}' of a budget is called '{renamed[name]}' now", FutureWarning, stacklevel=3)
    return renamed[name]
