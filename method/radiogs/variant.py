"""What an ablation changes: every row of the paper's ablations is a value of these fields, not a code path."""

from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

from radiogs_core.capabilities import PARTS, RelightingModes
from radiogs_core.errors import UsageError
from radiogs_core.learning.geometry import GeometryLearning
from radiogs_core.transport.plan import Effects, checked_effects

from .learning import MaterialLearning, SplitSumLearning
from .profile import FIRST_STAGE, RELEASED

Relighting = Literal["pbr", "finetuned", "surfels"]
"""How a model is seen under another light: by rays whose L_ind is a split sum at what they meet ("pbr"), by rays whose
L_ind is the radiance of surfels that were fine-tuned under that light ("finetuned"), or by splatting that radiance."""

RELIGHTING = RelightingModes(
    field="relighting",
    titles={
        "pbr": "rays that meet split-sum radiance",
        "finetuned": "rays to fine-tuned surfels",
        "surfels": "fine-tuned surfels alone",
    },
    default="pbr",
    by_steps=("surfels", "finetuned"),
    steps="finetune_iterations",
)

Shading = Literal["monte-carlo", "split-sum"]
"""L_PBR of stage 2: Eq. 8 over traced rays, or pre-filtered light without occlusion or indirect light."""

SCORING_ONLY = ("relighting", "met_light")
"""Fields that training does not read: cells that differ in these alone share the trained model."""


@dataclass(frozen=True)
class Variant:
    """A method variant; the defaults are the full method.

    radiometric_weight: lambda_rad of the inverse-rendering stage (paper: 0.2).
    detach: which side of the residual L_G - L_PBR gets no gradient: none, "pbr" (L_PBR) or "surfel" (L_G).
    initialise: stage 1 with the simplified radiometric consistency, or by novel-view synthesis alone ("nvs").
    view_share: share of the training views that both stages may see, in (0, 1].
    shading: see ``Shading``.
    incident: how V and L_ind enter L_rad: traced in every step with gradient to the surfels met ("traced"), without
    ("detached"), or once, before stage 2 begins, and never again ("precomputed").
    relighting: see ``Relighting``.
    met_light: how what "pbr" relighting's rays meet is lit: as far as it is open to the light, with what surfaces that
    hide the light send on (``met_surface.enclosed``), or as if nothing hid it ("unoccluded", the paper's).
    deviations: what of the released code is reproduced, by the names of ``profile.RELEASED``. Raises UsageError for
    any other.
    effects: what stage 2 and relighting simulate: "all", "auto" (those a scene needs, by measured evidence; see
    ``effects``), or the names of the effects that are on. Raises UsageError for what is no effect.
    given: parts of the truth that stage 2 begins with and holds (``given``), in any order; the variant keeps them in
    that of ``PARTS``. Raises UsageError for what is no part, for a choice of effects beside it, and for indirect light
    where shading has none.
    geometry, split_sum: weights, rates, schedule and starting values of stage 1, of the surfels and of their shading.
    materials: those of stage 2.
    """

    radiometric_weight: float = 0.2
    detach: Literal["none", "pbr", "surfel"] = "none"
    initialise: Literal["radiometric", "nvs"] = "radiometric"
    view_share: float = 1.0
    shading: Shading = "monte-carlo"
    incident: Literal["traced", "detached", "precomputed"] = "traced"
    relighting: Relighting = "pbr"
    met_light: Literal["occluded", "unoccluded"] = "occluded"
    deviations: tuple[str, ...] = ()
    effects: Effects = "all"
    given: tuple[str, ...] = ()
    geometry: GeometryLearning = field(default_factory=GeometryLearning)
    split_sum: SplitSumLearning = field(default_factory=SplitSumLearning)
    materials: MaterialLearning = field(default_factory=MaterialLearning)

    def __post_init__(self) -> None:
        unknown = set(self.deviations) - RELEASED.keys()
        if unknown:
            raise UsageError(
                f"unknown deviation '{sorted(unknown)[0]}'",
                "A deviation is something that the released code does otherwise than the paper.",
                f"Deviations: {', '.join(RELEASED)}.",
            )
        if self.radiometric_weight < 0:
            raise UsageError(f"radiometric_weight: {self.radiometric_weight} is not zero or above")
        if not 0 < self.view_share <= 1:
            raise UsageError(f"view_share: {self.view_share} is not above 0 and at most 1")
        object.__setattr__(self, "effects", checked_effects(self.effects))
        if self.effects != "all" and self.shading == "split-sum":
            raise UsageError(
                "a choice of effects for split-sum shading",
                "It has neither visibility nor indirect light, and draws no samples: there is nothing to leave out.",
                'Use effects = "all" with it, or shading = "monte-carlo".',
            )
        self._check_given()

    def _check_given(self) -> None:
        unknown = set(self.given) - set(PARTS)
        if unknown:
            raise UsageError(f"there is no part '{sorted(unknown)[0]}' to be given", f"Parts: {', '.join(PARTS)}.")
        object.__setattr__(self, "given", tuple(part for part in PARTS if part in self.given))
        if self.given and self.effects != "all":
            raise UsageError(
                "a choice of effects where parts of the truth are given",
                "What is given says what the rest is responsible for only if all of light transport is simulated.",
                'Use effects = "all" with it.',
            )
        if "indirect" in self.given and self.shading == "split-sum":
            raise UsageError(
                "indirect light that is given to split-sum shading",
                "It has no indirect light.",
                'Give other parts, or use shading = "monte-carlo".',
            )

    @property
    def surfel_learning(self) -> GeometryLearning:
        """``geometry`` with the deviations of the released code that are reproduced."""
        learning = self.geometry
        if "display-radiance" in self.deviations:
            learning = replace(learning, colour="display")
        if "premultiplied-encoding" in self.deviations:
            learning = replace(learning, encoding="premultiplied")
        return learning

    @property
    def straight(self) -> bool:
        """Whether images are encoded for display by ``straight`` radiance (see ``splatting.displayed``)."""
        return self.surfel_learning.encoding == "straight"

    def of_initialisation(self) -> dict[str, Any]:
        """The fields that decide stage 1, as plain values."""
        return {
            "initialise": self.initialise,
            "view_share": self.view_share,
            "deviations": sorted(FIRST_STAGE.intersection(self.deviations)),
            "geometry": asdict(self.geometry),
            "split_sum": asdict(self.split_sum),
        }

    def of_training(self) -> dict[str, Any]:
        """The fields that decide the trained model, as plain values."""
        return {name: value for name, value in asdict(self).items() if name not in SCORING_ONLY}
