"""Where the authors' released code departs from the paper: each departure by name, to be switched on by itself.

The profile ``paper`` has none of them: the paper's equations, every estimator unbiased. ``released`` has them all.
``docs/paper_and_code.md`` lists every discrepancy that is known, those below and those that are not reproduced.
"""

from collections.abc import Mapping

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
"""Those that stage 1 reads."""

PROFILES: Mapping[str, tuple[str, ...]] = {"paper": (), "released": tuple(RELEASED)}

FIXED_OFFSET = 0.05
"""World units; the released default (0.1 for a few scenes)."""

START_RADIANCE = 1.5
