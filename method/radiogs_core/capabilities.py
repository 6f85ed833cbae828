"""Optional protocols of methods, stages and models, beyond the contract; the harness checks by ``isinstance``."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal, Protocol, get_args, runtime_checkable

from jaxtyping import Float
from torch import Tensor

from .contract import Prepared, Run, Trained
from .errors import DataError
from .scene.camera import Camera
from .scene.light import EnvironmentMap
from .scene.scene import Scene

Part = Literal["geometry", "light", "albedo", "roughness", "indirect"]
PARTS: tuple[Part, ...] = get_args(Part)
"""Parts of the truth that a method may be given: the shape of the surfaces, the distant light of the training views,
the two materials, and the light that arrives from other surfaces (L_ind)."""

FROM_LIGHT: tuple[Part, ...] = ("light", "indirect")
"""Parts that need the true light of the scene; every part but ``light`` needs the true surfaces."""


@runtime_checkable
class Closing(Protocol):
    """A stage with resources besides memory, such as a process or an open file."""

    def close(self) -> None:
        """Release these resources; called when the stage ends, fails or is interrupted."""


@runtime_checkable
class OffersRecipes(Protocol):
    """A method with recipes: named values for all of its settings, for ``--recipe NAME`` and rows of suites."""

    @property
    def recipes(self) -> Mapping[str, str]:
        """Title of each recipe, by name."""

    @property
    def published_recipe(self) -> str:
        """Name of the recipe with the published values, which alone may be called by the published method's name."""

    def recipe_values(self, name: str, layout: str, scene: str) -> Mapping[str, Any]:
        """Fields of the variant by dotted names, as plain values, for a scene by its layout and name.

        Raises UsageError for an unknown recipe.
        """

    def recipe_table(self) -> str:
        """Every value of every recipe with its source, as Markdown, for ``radiogs-bench methods NAME --recipes``."""


@dataclass(frozen=True)
class RelightingModes:
    """The ways in which a method renders a trained model under another light."""

    field: str
    """Dotted name of the variant's field that selects the mode. Training does not read it."""
    titles: Mapping[str, str]
    """Title of each mode in tables and figures, by the mode's name."""
    default: str
    """The mode of the full method."""
    by_steps: tuple[str, ...] = ()
    """The modes that prepare for a light by steps of optimisation, such as fine-tuning, in the order of figures."""
    steps: str = ""
    """Dotted name of the budget's field with the number of these steps."""
    reference: str = ""
    """The mode without bias, however slow, to which the others are compared; empty if the method has none."""

    def plain(self) -> dict[str, Any]:
        """The modes as plain values, as the manifest of a run stores them."""
        return {**asdict(self), "titles": dict(self.titles), "by_steps": list(self.by_steps)}


@runtime_checkable
class RelitInModes(Protocol):
    """A method that can render a trained model under another light in several ways, for ``radiogs-bench relight``."""

    @property
    def relighting_modes(self) -> RelightingModes:
        """The modes; each is a value of a field of the variant."""


@runtime_checkable
class RelitByReference(Protocol):
    """A trained model that can also be relit in the reference mode of its method (``RelightingModes.reference``)."""

    def reference(
        self, light: EnvironmentMap, albedo_scale: Float[Tensor, "3"], after_step: Callable[[], None]
    ) -> Prepared:
        """The model under ``light`` in the reference mode, with random numbers independent of ``Trained.prepare``.

        For the arguments see ``Trained.prepare``.
        """


@runtime_checkable
class Remarking(Protocol):
    """A prepared model with remarks on how it is rendered."""

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences, such as which effects are left out and why."""


@dataclass(frozen=True)
class EffectRecord:
    """The decision about one light-transport effect, with its evidence."""

    effect: str
    """Name of the effect, such as ``indirect``; ``plan`` for the plan as a whole."""
    verdict: str
    """"on" or "off"."""
    why: str
    """The reason, in words."""
    iteration: int
    """Iteration of training at which the decision was made; 0 for a model that is not being trained."""
    seed: int
    """Seed of the probe."""
    tolerance: float
    """Tolerated loss, dB of PSNR."""
    measured: Mapping[str, float | None] | None
    """Measurements by name; None if nothing was measured.

    A value is None if it is not finite. ``contribution``: estimated loss without the effect, dB of PSNR; ``lowest`` and
    ``bound``: its lower and upper bounds; ``worst``: the loss under the worst correlation of errors, dB. ``rays``: rays
    that a step saves without the effect; ``share``: share of a step's work that it saves.
    """


@dataclass(frozen=True)
class Probe:
    """The light-transport effects that a scene or a trained model needs, with evidence and images of differences."""

    tolerance: float
    """Tolerated loss, dB of PSNR, relative to ``mse``."""
    mse: float
    """Mean squared error of the method's own images, display sRGB."""
    records: tuple[EffectRecord, ...]
    """One record for each effect, and one for the plan as a whole."""
    plan: Mapping[str, Any]
    """The effects to be simulated, as plain values."""
    bounces: int | None
    """Number of surfaces that light has to be followed over; None if it is not known."""
    reference: Float[Tensor, "height width 3"]
    """One view, display sRGB: its photograph, or the model's own image of it (see ``pictured``)."""
    pictured: bool
    """Whether ``reference`` is a photograph; if not, it was rendered."""
    differences: Mapping[str, Float[Tensor, "height width"]]
    """By effect: absolute change of each pixel of ``reference`` without it, display sRGB, mean over channels."""

    @property
    def psnr(self) -> float:
        """PSNR of the error to which the tolerance is relative, dB."""
        return -10 * math.log10(self.mse) if self.mse > 0 else math.inf

    def plain(self) -> dict[str, Any]:
        """Everything but the images, as plain values."""
        return {
            "mse": self.mse,
            "tolerance": self.tolerance,
            "plan": dict(self.plan),
            "bounces": self.bounces,
            "evidence": [asdict(record) for record in self.records],
        }


@runtime_checkable
class Probing(Protocol):
    """A method that can measure which effects are needed; methods that always simulate all do not offer it."""

    def probe(self, run: Run, trained: Trained | None, light: EnvironmentMap | None) -> Probe:
        """The effects that training on the run's scene needs, or, with a ``light``, relighting by it.

        ``trained``: the model to probe; None: the true surfaces and light of the scene. Raises DataError for a scene
        whose surfaces and light are not known.
        """


@dataclass(frozen=True)
class StepKind:
    """Steps of a stage that do the same amount of work."""

    title: str
    """Title in tables, such as ``step``."""
    steps: frozenset[int]
    """Indices of these steps in the short run, from 0."""
    whole: int
    """Number of these steps in the whole run."""


@dataclass(frozen=True)
class Relighting:
    """A way to relight a trained model."""

    title: str
    """Title in tables."""
    variant: Any
    """The variant that relights this way; all ways share one trained model."""
    whole: int
    """Steps of its preparation in the whole run; steps of the short run are counted as they run."""


@dataclass(frozen=True)
class ShortRun:
    """A run with a few steps of every kind, and with a model of the requested size."""

    variant: Any
    """The variant to run."""
    budget: Any
    """The budget to run with."""
    kinds: Mapping[str, tuple[StepKind, ...]]
    """The kinds of steps of each stage, by the stage's name."""
    relighting: tuple[Relighting, ...]
    """All ways to relight but the reference (``RelightingModes.reference``), which is slow by design."""


@runtime_checkable
class Rehearsing(Protocol):
    """A method whose runs can be shortened without making the model smaller, for ``radiogs-bench rehearse``."""

    @property
    def size_name(self) -> str:
        """The unit of a model's size, such as ``surfels``."""

    def sizes(self, budget: Any) -> tuple[int, int]:
        """The size of the model at the start of a run, and the largest that it may reach."""

    def short_run(self, variant: Any, budget: Any, size: int) -> ShortRun:
        """A run of a few steps, whose model has about ``size`` elements from the first step on."""


@runtime_checkable
class TakesGiven(Protocol):
    """A method that can use parts of the truth instead of learning them, for the rows of suite ``oracles``."""

    @property
    def given_parts(self) -> tuple[str, ...]:
        """The parts, of ``PARTS``, that the method accepts."""

    def with_given(self, variant: Any, parts: tuple[str, ...]) -> Any:
        """The variant that is given these parts and learns all others.

        Given parts are frozen: training does not change them, and the trained model is rendered with them. Under
        another light a model keeps given geometry, albedo and roughness, because given light and indirect light belong
        to the training views. ``require_truth`` checks whether a scene knows the parts. Raises UsageError for a part
        that the method does not accept.
        """


Quantity = Literal["roughness", "roughness variation", "brightness", "brightness, albedo free"]
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
"""Quantities that images may fail to determine, with the unit in which their change is given.

roughness: a number that is added to the roughness of every surface. roughness variation: the share of its distance to
the mean by which every roughness moves towards the mean (1: all are equal, -1: twice as far from it). brightness: the
natural logarithm of the factor by which all albedo is multiplied and the light is divided. brightness, albedo free: the
logarithm of the divisor of the light, while each albedo takes the value that hides this change best."""


@runtime_checkable
class Varying(Protocol):
    """A trained model under its own light, for a few cameras, that can be rendered with one quantity changed."""

    @property
    def values(self) -> Mapping[str, float]:
        """The recovered value of every quantity of ``QUANTITIES`` that was learnt, not given.

        ``roughness``: mean over the surfaces that the cameras see; ``roughness variation``: standard deviation over
        these; ``brightness`` of either kind: mean linear radiance of the light over all directions and channels.
        """

    def images(self, quantity: str, amount: float) -> list[Float[Tensor, "height width 3"]]:
        """An image for each camera, display sRGB on black, with one quantity changed by ``amount`` (0: as recovered).

        The albedo of each surface adapts, to hide as much of the change as it can in all views. The difference that is
        left in the images is the one that only this quantity explains.
        """


@runtime_checkable
class Nuisance(Protocol):
    """The nuisance parameters of one quantity: everything else that was learnt and may compensate its change.

    An answer is a vector of their changes, in units of the distance within which the images are about linear in them.
    """

    @property
    def like(self) -> Float[Tensor, " parameters"]:
        """An answer that changes nothing: zeros, on the model's device."""

    @property
    def scale(self) -> Float[Tensor, " parameters"]:
        """Size of the answer at which each parameter alone changes the images about equally (Jacobi preconditioner)."""

    def change(self, answer: Float[Tensor, " parameters"]) -> list[Float[Tensor, "height width 3"]]:
        """The linearised change of each image by an answer: the product with the Jacobian, display sRGB."""

    def pull(self, images: Sequence[Float[Tensor, "height width 3"]]) -> Float[Tensor, " parameters"]:
        """The transposed product: the derivative to every parameter of the sum of ``images`` times ``change``."""

    def images(self, amount: float, answer: Float[Tensor, " parameters"]) -> list[Float[Tensor, "height width 3"]]:
        """``Varying.images`` with the quantity changed by ``amount`` and everything else by an answer, not linearised.

        Parameters stay within their physical bounds. The answer of zeros gives ``Varying.images``.
        """


@runtime_checkable
class VaryingFreely(Varying, Protocol):
    """A ``Varying`` whose other parameters can compensate the change of a quantity."""

    def nuisance(self, quantity: str) -> Nuisance:
        """The nuisance parameters of a quantity.

        They never contain the quantity itself: no answer may undo its change.
        """


@runtime_checkable
class Variable(Protocol):
    """A trained model that supports the measurement of what images determine (docs/what_images_determine.md)."""

    def varying(self, cameras: Sequence[Camera]) -> Varying:
        """The model, ready to be rendered for these cameras with a quantity changed."""


def require_truth(scene: Scene, parts: tuple[str, ...]) -> None:
    """Raises DataError unless the scene knows the truth of all ``parts``."""
    for part in parts:
        lacks = [
            name
            for name, absent, needed in (
                ("surfaces", scene.surfaces is None, part != "light"),
                ("light", scene.training_light is None, part in FROM_LIGHT),
            )
            if absent and needed
        ]
        if lacks:
            raise DataError(
                f"the true {' and '.join(lacks)} of scene '{scene.name}' are not known: '{part}' cannot be given",
                "Generated scenes have both: the scenes of the package, and those of `radiogs-bench datasets generate`."
                " TensoIR's scenes have a known light; captures have neither.",
                "Choose among them (`radiogs-bench datasets list`), or leave out the rows that give this part.",
            )
