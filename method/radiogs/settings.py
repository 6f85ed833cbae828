"""Settings of RadioGS: how much work a run does, what an ablation changes, and what the released code does otherwise.

Every row of the paper's ablations is a value of ``Variant``'s fields, not a code path; ``learning`` has the weights,
rates and starting values. ``docs/paper_and_code.md`` lists every discrepancy between paper and code that is known.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

from radiogs_core.capabilities import PARTS, RelightingModes
from radiogs_core.errors import UsageError
from radiogs_core.learning.geometry import GeometryLearning
from radiogs_core.on_surfels.settings import GEOMETRY_PRESETS, SurfelBudget, SurfelVariant, by_name
from radiogs_core.transport.plan import Effects, checked_effects

from .learning import MaterialLearning, SplitSumLearning


@dataclass(frozen=True, kw_only=True)
class Budget(SurfelBudget):
    """How much work a run may do."""

    shown_only = (
        "relight_hemisphere_samples",
        "relight_light_samples",
        "finetune_iterations",
        "finetune_surfels",
        "finetune_samples",
    )

    consistency_surfels: int
    """Random surfels that L_rad of a step is taken over (N_g)."""
    incident_samples: int
    """Rays of each of these surfels (N_s), and directions of the light that is kept of all surfels."""
    refresh_interval: int
    """Steps from one tracing of the light on all surfels to the next."""
    relight_hemisphere_samples: int
    """Rays of each surfel under another light that are spread over the hemisphere."""
    relight_light_samples: int
    """Rays of each surfel under another light that are drawn from the light."""
    finetune_iterations: int
    """Steps of fine-tuning under another light (stage 3)."""
    finetune_surfels: int
    """Surfels that a step of fine-tuning takes its loss over."""
    finetune_samples: int
    """Rays of each of these surfels."""


INVERSE_ONLY = (
    "inverse_iterations", "consistency_surfels", "incident_samples", "refresh_interval", *Budget.shown_only,
)  # fmt: skip
"""Fields of ``Budget`` that stage 1 does not read: runs that differ in these alone share it."""

PRESETS = by_name(
    Budget(
        name="smoke",
        geometry=GEOMETRY_PRESETS["smoke"],
        inverse_iterations=20,
        consistency_surfels=64,
        incident_samples=8,
        refresh_interval=10,
        light_height=8,
        relight_hemisphere_samples=16,
        relight_light_samples=16,
        finetune_iterations=10,
        finetune_surfels=128,
        finetune_samples=16,
    ),
    Budget(
        name="tiny",
        geometry=GEOMETRY_PRESETS["tiny"],
        inverse_iterations=600,
        consistency_surfels=256,
        incident_samples=32,
        refresh_interval=100,
        light_height=16,
        relight_hemisphere_samples=64,
        relight_light_samples=64,
        finetune_iterations=200,
        finetune_surfels=512,
        finetune_samples=64,
    ),
    Budget(
        name="small",
        geometry=GEOMETRY_PRESETS["small"],
        inverse_iterations=3000,
        consistency_surfels=1024,
        incident_samples=64,
        refresh_interval=100,
        light_height=32,
        relight_hemisphere_samples=128,
        relight_light_samples=64,
        finetune_iterations=500,
        finetune_surfels=2048,
        finetune_samples=128,
    ),
    Budget(
        name="paper",
        geometry=GEOMETRY_PRESETS["paper"],
        inverse_iterations=20_000,
        consistency_surfels=4096,
        incident_samples=64,
        refresh_interval=100,
        light_height=64,
        relight_hemisphere_samples=256,
        relight_light_samples=128,
        finetune_iterations=2000,
        finetune_surfels=8192,
        finetune_samples=256,
    ),
)


RELEASED: Mapping[str, str] = {
    "hemisphere-floor": "incident directions end 10 degrees above the horizon, and the first one is the normal",
    "fixed-offset": "rays start 0.05 world units from their surfel, whatever its scale",
    "one-sided-rays": "rays meet surfels from their visible side alone, at any distance",
    "light-detached": "L_rad has no gradient to the light",
    "image-weight": "the image loss of L_PBR weighs L1 by 1.0 instead of 0.8",
    "premultiplied-encoding": "blended radiance is encoded for display together with the black around it",
    "display-radiance": "stage 1 learns in display colour; stage 2 takes what it learnt for linear radiance",
    "start-light": "stage 2 begins under a constant radiance of 1.5, whatever the exposure",
    "spread-views": "new views are shaded along N_s directions over the hemisphere, none drawn from the light",
}
"""Deviations by name. The order is that of the documentation."""

FIRST_STAGE = frozenset({"display-radiance", "premultiplied-encoding"})
"""Deviations that stage 1 reads."""

PROFILES: Mapping[str, tuple[str, ...]] = {"paper": (), "released": tuple(RELEASED)}

FIXED_OFFSET = 0.05
"""World units; the released default (0.1 for a few scenes)."""

START_RADIANCE = 1.5

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


@dataclass(frozen=True)
class Variant(SurfelVariant):
    """A variant of RadioGS; the defaults are the full method.

    Raises UsageError for an unknown deviation, effect or part, and for choices that exclude each other.
    """

    shown_only = ("relighting", "met_light")

    radiometric_weight: float = 0.2
    """lambda_rad of stage 2 (paper: 0.2)."""
    detach: Literal["none", "pbr", "surfel"] = "none"
    """Side of the residual L_G - L_PBR that has no gradient: none, L_PBR ("pbr") or L_G ("surfel")."""
    initialise: Literal["radiometric", "nvs"] = "radiometric"
    """Stage 1 with the simplified radiometric consistency, or by novel-view synthesis alone ("nvs")."""
    shading: Shading = "monte-carlo"
    """L_PBR of stage 2 (see ``Shading``)."""
    incident: Literal["traced", "detached", "precomputed"] = "traced"
    """V and L_ind of L_rad: traced in every step with gradient to the surfels that rays hit ("traced"), without
    ("detached"), or once, before stage 2 begins ("precomputed")."""
    relighting: Relighting = "pbr"
    """How a model is shown under another light (see ``Relighting``)."""
    met_light: Literal["occluded", "unoccluded"] = "occluded"
    """Light on the surfaces that the rays of "pbr" relighting hit: as far as they are open to it, with the light that
    their occluders send on (``hit_surface.enclosed``), or unoccluded, as in the paper."""
    deviations: tuple[str, ...] = ()
    """Deviations of the released code that are reproduced, by the names of ``RELEASED``."""
    effects: Effects = "all"
    """Effects that stage 2 and relighting simulate: "all", "auto" (those a scene needs, by measured evidence; see
    ``effects``), or the names of the effects that are on."""
    given: tuple[str, ...] = ()
    """Parts of the truth that stage 2 begins with and holds (``oracle``), in the order of ``PARTS``."""
    split_sum: SplitSumLearning = field(default_factory=SplitSumLearning)
    """Weights, rates and starting values of stage 1's shading."""
    materials: MaterialLearning = field(default_factory=MaterialLearning)
    """Weights, rates and starting values of stage 2."""

    def __post_init__(self) -> None:
        super().__post_init__()
        unknown = set(self.deviations) - RELEASED.keys()
        if unknown:
            raise UsageError(
                f"unknown deviation '{sorted(unknown)[0]}'",
                "A deviation is something that the released code does otherwise than the paper.",
                f"Deviations: {', '.join(RELEASED)}.",
            )
        self.require("zero or above", "radiometric_weight")
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
