"""Settings of RadioGS: the budget of a run, the variants of ablations, and the deviations of the released code.

Every row of the paper's ablations is a value of ``Variant``'s fields, not a code path; ``learning`` has the weights,
rates and initial values; ``recipes`` has all of them by recipe.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

from radiogs_core.capabilities import PARTS, RelightingModes
from radiogs_core.errors import UsageError
from radiogs_core.learning.geometry import GeometryLearning
from radiogs_core.learning.solver_rates import SolverRates
from radiogs_core.on_surfels.settings import GEOMETRY_PRESETS, SurfelBudget, SurfelVariant, by_name
from radiogs_core.plain_values import require
from radiogs_core.transport.plan import Effects, checked_effects
from radiogs_core.transport.prefiltered_light import Masking

from .learning import MaterialLearning, SplitSumLearning


@dataclass(frozen=True, kw_only=True)
class Budget(SurfelBudget):
    """The amount of work of a run."""

    shown_only = (
        "relight_hemisphere_samples",
        "relight_light_samples",
        "relight_bounces",
        "relight_paths",
        "finetune_iterations",
        "finetune_surfels",
        "finetune_samples",
    )

    consistency_surfels: int
    """Number of random surfels in the L_rad of a step (N_g)."""
    incident_samples: int
    """Number of rays of each of these surfels (N_s), and of directions of each surfel's cached light."""
    refresh_interval: int = 100
    """Steps between two tracings of the light on all surfels."""
    relight_hemisphere_samples: int
    """Number of rays of each surfel in relighting that are spread over the hemisphere."""
    relight_light_samples: int
    """Number of rays of each surfel in relighting that are drawn from the light."""
    relight_bounces: int = 4
    """Number of surfaces that light meets before it arrives, in relighting by traced bounces; 1 or more."""
    relight_paths: int = 1024
    """Number of paths of each surfel in relighting by path tracing."""
    finetune_iterations: int
    """Number of steps of fine-tuning under another light (stage 3)."""
    finetune_surfels: int
    """Number of surfels in the loss of a step of fine-tuning."""
    finetune_samples: int
    """Number of rays of each of these surfels."""


INVERSE_ONLY = (
    "inverse_iterations", "consistency_surfels", "incident_samples", "refresh_interval", *Budget.shown_only,
)  # fmt: skip
"""Fields of ``Budget`` that stage 1 does not read: runs that differ only in these share stage 1."""

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
        relight_bounces=2,
        relight_paths=64,
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
        light_height=64,
        relight_hemisphere_samples=256,
        relight_light_samples=128,
        finetune_iterations=2000,
        finetune_surfels=8192,
        finetune_samples=256,
    ),
)
"""Budgets by the names of their presets."""

DEVIATIONS: Mapping[str, str] = {
    "hemisphere-floor": "incident directions end 10 degrees above the horizon, and the first one is the normal",
    "fixed-offset": "rays start ``ray_offset`` world units from their surfel, whatever its scale",
    "one-sided-rays": "rays hit surfels from their visible side alone, at any distance",
    "light-detached": "L_rad has no gradient to the light",
    "image-weight": "the image loss of L_PBR weighs L1 by 1.0 instead of 0.8",
    "premultiplied-encoding": "blended radiance is encoded for display together with the black around it",
    "display-radiance": "stage 1 learns in display colour; stage 2 uses its result as linear radiance",
    "start-light": "stage 2 begins under a constant radiance of 1.5, whatever the exposure",
    "spread-views": "new views are shaded along N_s directions over the hemisphere, none drawn from the light",
}
"""Deviations of the released code from the recommended recipe, by name, in the order of the documentation."""

FIRST_STAGE = frozenset({"display-radiance", "premultiplied-encoding"})
"""Deviations that stage 1 reads."""

START_RADIANCE = 1.5
"""Linear radiance of the initial light with ``start-light``."""

Relighting = Literal["pbr", "bounces", "finetuned", "surfels", "path"]
"""Mode of relighting. "pbr": by rays whose L_ind is the split sum at their hits. "bounces": by rays whose L_ind is
gathered bounce by bounce over the same rays. "finetuned": by rays whose L_ind is the radiance of surfels that were
fine-tuned under the new light. "surfels": by splatting the fine-tuned radiance. "path": by path tracing with all
effects, the reference."""

PATH: Relighting = "path"
"""The mode of the reference."""

RELIGHTING = RelightingModes(
    field="relighting",
    titles={
        "pbr": "rays that meet split-sum radiance",
        "bounces": "rays, traced bounces",
        "finetuned": "rays to fine-tuned surfels",
        "surfels": "fine-tuned surfels alone",
        "path": "path tracing",
    },
    default="bounces",
    by_steps=("surfels", "finetuned"),
    steps="finetune_iterations",
    reference=PATH,
)
"""The modes of relighting for the harness (see ``Relighting``)."""

Shading = Literal["monte-carlo", "split-sum"]
"""L_PBR of stage 2. "monte-carlo": Eq. 8 over traced rays. "split-sum": prefiltered light without occlusion and without
indirect light."""


@dataclass(frozen=True)
class Variant(SurfelVariant):
    """A variant of RadioGS; the defaults are the full method.

    Raises UsageError for an unknown deviation, effect or part, and for settings that contradict each other.
    """

    shown_only = ("relighting", "met_light", "finetuning")

    radiometric_weight: float = 0.2
    """Weight lambda_rad of L_rad in stage 2 (paper: 0.2)."""
    detach: Literal["none", "pbr", "surfel"] = "none"
    """Side of the residual L_G - L_PBR that has no gradient: neither ("none"), L_PBR ("pbr") or L_G ("surfel")."""
    initialise: Literal["radiometric", "nvs"] = "radiometric"
    """Stage 1 with the simplified radiometric consistency ("radiometric"), or novel-view synthesis alone ("nvs")."""
    shading: Shading = "monte-carlo"
    """L_PBR of stage 2 (see ``Shading``)."""
    incident: Literal["traced", "detached", "precomputed"] = "traced"
    """V and L_ind of L_rad: traced in every step with gradient to the surfels that rays hit ("traced"), without
    gradient ("detached"), or only once, before stage 2 begins ("precomputed")."""
    relighting: Relighting = "bounces"
    """Mode of relighting (see ``Relighting``)."""
    met_light: Literal["occluded", "unoccluded"] = "occluded"
    """Light on the surfaces that rays hit in "pbr" relighting. "occluded": reduced by their openness, plus the light
    that their occluders scatter (``hit_surface.enclosed``). "unoccluded": as in the paper."""
    deviations: tuple[str, ...] = ()
    """Deviations of the released code to reproduce, by the names of ``DEVIATIONS``."""
    ray_offset: float = 0.05
    """Distance from their surfel at which rays start with the deviation ``fixed-offset``, world units (released code:
    0.05, and 0.1 in a few scenes)."""
    masking: Masking = "schlick"
    """Masking in the pre-integrated BRDF of all split sums (see ``prefiltered_light.Masking``)."""
    effects: Effects = "all"
    """Effects that stage 2 and relighting simulate: "all", "auto" (the effects that a scene needs, by measured
    evidence; see ``effects``), or the names of the effects that are on."""
    given: tuple[str, ...] = ()
    """Parts of the truth with which stage 2 begins and which it freezes (``oracle``), in the order of ``PARTS``."""
    split_sum: SplitSumLearning = field(default_factory=SplitSumLearning)
    """Weights, rates and initial values of stage 1's shading."""
    materials: MaterialLearning = field(default_factory=MaterialLearning)
    """Weights, rates and initial values of stage 2."""
    finetuning: SolverRates = field(default_factory=SolverRates)
    """Learning rates of fine-tuning under another light (stage 3)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        unknown = set(self.deviations) - DEVIATIONS.keys()
        if unknown:
            raise UsageError(
                f"unknown deviation '{sorted(unknown)[0]}'",
                "A deviation is a difference of the released code from the paper.",
                f"Deviations: {', '.join(DEVIATIONS)}.",
            )
        require(self, "zero or above", "radiometric_weight", "ray_offset")
        object.__setattr__(self, "effects", checked_effects(self.effects))
        if self.effects != "all" and self.shading == "split-sum":
            raise UsageError(
                "a choice of effects for split-sum shading",
                "It has neither visibility nor indirect light, and draws no samples: no effect can be left out.",
                'Use effects = "all" with it, or shading = "monte-carlo".',
            )
        self._check_given()

    def _check_given(self) -> None:
        unknown = set(self.given) - set(PARTS)
        if unknown:
            raise UsageError(
                f"there is no part '{sorted(unknown)[0]}' of the truth", remedy=f"Parts: {', '.join(PARTS)}."
            )
        object.__setattr__(self, "given", tuple(part for part in PARTS if part in self.given))
        if self.given and self.effects != "all":
            raise UsageError(
                "a choice of effects where parts of the truth are given",
                "Given parts isolate the error of the other parts only if all of light transport is simulated.",
                'Use effects = "all" with it.',
            )
        if "indirect" in self.given and self.shading == "split-sum":
            raise UsageError(
                "given indirect light with split-sum shading",
                "Split-sum shading has no indirect light.",
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
        """Whether images are encoded for display from straight radiance (``kernels.image.display.displayed``)."""
        return self.surfel_learning.encoding == "straight"

    def of_initialisation(self) -> dict[str, Any]:
        """The fields that decide stage 1, as plain values."""
        return {
            "initialise": self.initialise,
            "view_share": self.view_share,
            "deviations": sorted(FIRST_STAGE.intersection(self.deviations)),
            "geometry": asdict(self.geometry),
            "split_sum": asdict(self.split_sum),
            "masking": self.masking,
        }
