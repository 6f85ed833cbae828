"""Capabilities that a method, or something it makes, may offer beyond the contract; the harness checks for them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal, Protocol, get_args, runtime_checkable

from jaxtyping import Float
from torch import Tensor

from .contract import Run, Trained
from .errors import DataError
from .scene.camera import Camera
from .scene.light import EnvironmentMap
from .scene.scene import Scene

Part = Literal["geometry", "light", "albedo", "roughness", "indirect"]
PARTS: tuple[Part, ...] = get_args(Part)
"""Parts of the truth that may be given to a method: the shape of the surfaces, the distant light of the training
views, the two materials, and the light that arrives from other surfaces (L_ind)."""

FROM_LIGHT: tuple[Part, ...] = ("light", "indirect")
"""Parts for which the true light has to be known; for all but ``light``, the true surfaces."""


@runtime_checkable
class Closing(Protocol):
    """A stage that holds more than memory, such as a process or a file."""

    def close(self) -> None:
        """Let it go; called when stepping ends, however it ends."""


@runtime_checkable
class Profiled(Protocol):
    """A method whose variant has named settings, for ``radiogs-bench train --profile NAME``."""

    @property
    def profiles(self) -> Mapping[str, Mapping[str, Any]]:
        """Fields of the variant by the profile's name, as plain values."""


@dataclass(frozen=True)
class RelightingModes:
    """The ways in which a method shows a trained model under another light."""

    field: str
    """The field of the variant that holds the mode, by its dotted name. Training does not read it."""
    titles: Mapping[str, str]
    """The title of each mode in tables and figures, by the mode's name."""
    default: str
    """The mode of the full method."""
    by_steps: tuple[str, ...] = ()
    """The modes that prepare for a light by steps of optimisation, such as fine-tuning, in the order of figures."""
    steps: str = ""
    """The field of the budget with the number of these steps, by its dotted name."""

    def plain(self) -> dict[str, Any]:
        """The modes as plain values, as the manifest of a run keeps them."""
        return {**asdict(self), "titles": dict(self.titles), "by_steps": list(self.by_steps)}


@runtime_checkable
class RelitInModes(Protocol):
    """A method that can show a trained model under another light in several ways, for ``radiogs-bench relight``."""

    @property
    def relighting_modes(self) -> RelightingModes:
        """The modes; each is a value of a field of the variant."""


@runtime_checkable
class Remarking(Protocol):
    """A prepared model that has something to say of how it is shown."""

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences, such as which effects are left out and why."""


@dataclass(frozen=True)
class EffectRecord:
    """The decision about one light-transport effect, with its evidence."""

    effect: str
    verdict: str
    """"on", "local" (kept where it matters) or "off"."""
    why: str
    """The reason in words."""
    iteration: int
    """The iteration of training; 0 for a scene or model that is not being trained."""
    seed: int
    tolerance: float
    """The tolerated loss, dB of PSNR."""
    measured: Mapping[str, float | None] | None
    """Values by name, None for one that is not finite: ``contribution``, ``lowest`` and ``bound`` (estimated cost of
    leaving the effect out, and its bounds) and ``worst`` (whatever the errors' correlation), all in dB; ``rays``, and
    ``share`` of a step's work. None: nothing was measured."""


@dataclass(frozen=True)
class Probe:
    """The effects that a scene or a trained model needs: decisions with evidence, and images of the differences."""

    tolerance: float
    """The tolerated loss, dB of PSNR, relative to ``mse``."""
    mse: float
    """Mean squared error, display sRGB."""
    records: tuple[EffectRecord, ...]
    plan: Mapping[str, Any]
    """The effects to simulate, as plain values."""
    bounces: int | None
    """Number of surfaces that light has to be followed over; None where that is not known."""
    reference: Float[Tensor, "height width 3"]
    """One view, display sRGB: a picture of the scene, or as it is relit (see ``pictured``)."""
    pictured: bool
    """Whether ``reference`` is a picture of the scene."""
    differences: Mapping[str, Float[Tensor, "height width"]]
    """The change of each pixel of that view without an effect, mean over channels, by effect."""

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
    """A method that can say which effects are needed; methods that simulate all that they have do not offer this."""

    def probe(self, run: Run, trained: Trained | None, light: EnvironmentMap | None) -> Probe:
        """Probe training on the run's scene, or a trained model of it; with a ``light``, probe relighting.

        Without a trained model, the scene is probed as it truly is. Raises DataError for a scene whose surfaces and
        light are not known.
        """


@dataclass(frozen=True)
class StepKind:
    """Steps of a stage that cost alike."""

    title: str
    steps: frozenset[int]
    """Their numbers in the short run, from 0."""
    whole: int
    """Their number in the whole run."""


@dataclass(frozen=True)
class Relighting:
    """A way to relight a trained model, for rehearsals."""

    title: str
    variant: Any
    """The variant with this mode; training is the same for all modes."""
    whole: int
    """Steps of the preparation in the whole run; those of the short run are counted as they are taken."""


@dataclass(frozen=True)
class ShortRun:
    """Few steps of every kind, with a model of a stated size."""

    variant: Any
    budget: Any
    kinds: Mapping[str, tuple[StepKind, ...]]
    """Kinds of steps of each stage, by the stage's name."""
    relighting: tuple[Relighting, ...]
    """All ways of relighting."""


@runtime_checkable
class Rehearsing(Protocol):
    """A method whose runs can be shortened without making the model smaller, for ``radiogs-bench rehearse``."""

    @property
    def size_name(self) -> str:
        """The unit of its models' size, such as ``surfels``."""

    def sizes(self, budget: Any) -> tuple[int, int]:
        """The size at which a run begins, and the largest that it may reach."""

    def short_run(self, variant: Any, budget: Any, size: int) -> ShortRun:
        """A run of few steps whose model has about this size from the first step on."""


@dataclass(frozen=True)
class TrainingImages:
    """Number of the training images, and their size in pixels."""

    views: int
    width: int
    height: int


@dataclass(frozen=True)
class MemoryPhase:
    """Bytes on the device for one kind of work."""

    title: str
    held: int
    """Bytes before and after the work."""
    peak: int
    """Most bytes during the work."""


@runtime_checkable
class PlansMemory(Protocol):
    """A method that knows by formula what its runs hold, for ``radiogs-bench rehearse --by-formula``."""

    def memory(self, variant: Any, budget: Any, size: int, images: TrainingImages) -> tuple[MemoryPhase, ...]:
        """Each phase of a run whose models have this size (see ``Rehearsing``)."""


@runtime_checkable
class TakesGiven(Protocol):
    """A method that can take parts of the truth instead of finding them: the rows of suite ``oracles``."""

    @property
    def given_parts(self) -> tuple[str, ...]:
        """Which of ``PARTS`` it can take."""

    def with_given(self, variant: Any, parts: tuple[str, ...]) -> Any:
        """The variant to which these parts are given and all others are not.

        Training does not change given parts, and the trained model is shown with them. Under another light
        a model keeps given geometry, albedo and roughness; light and indirect light are those of the training views.
        ``require_truth`` says whether a scene has it. Raises UsageError for a part that it cannot take.
        """


Quantity = Literal["roughness", "roughness variation", "brightness", "brightness, albedo free"]
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
"""Quantities that images may fail to determine, and the unit of a change.

roughness: added to that of every surface. roughness variation: the share of the way that every roughness moves to their
mean (1: all alike, -1: twice as far from it). brightness: the natural logarithm of the factor by which all albedo grows
and light is divided. brightness, albedo free: the same of the light, while each albedo becomes what hides that best."""


@runtime_checkable
class Varying(Protocol):
    """A trained model under its own light, seen by a few cameras, that can be shown with one quantity changed."""

    @property
    def values(self) -> Mapping[str, float]:
        """The recovered value of every quantity of ``QUANTITIES`` that training was free to find.

        ``roughness``: the mean over what the cameras see; ``roughness variation``: the standard deviation over that;
        ``brightness`` of either kind: mean linear radiance of the light over all directions and channels.
        """

    def images(self, quantity: str, amount: float) -> list[Float[Tensor, "height width 3"]]:
        """An image for each camera, display sRGB on black, with one quantity changed by an amount; 0 is as recovered.

        A change that a different albedo of the single surfaces would hide in all views is to be hidden so: what is left
        in the images is what only this quantity explains.
        """


@runtime_checkable
class Variable(Protocol):
    """A trained model of which it can be measured what the images determine (docs/what_images_determine.md)."""

    def varying(self, cameras: Sequence[Camera]) -> Varying:
        """The model, ready to be seen by these cameras with a quantity changed."""


def require_truth(scene: Scene, parts: tuple[str, ...]) -> None:
    """Raise DataError unless the truth of all these parts is known of a scene."""
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
                "Scenes that were generated know both: those that come with the package, and those of"
                " `radiogs-bench datasets generate`. TensoIR's scenes know their light; captures know neither.",
                "Choose among them (`radiogs-bench datasets list`), or leave out what gives this part.",
            )
