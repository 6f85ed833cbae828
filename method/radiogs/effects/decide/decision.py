"""The rule: what is left out must be shown to matter little, and must cost something."""

from .evidence import Measured, Verdict
from .tolerance import TOLERANCE_DB

LEAST_SHARE = 0.001
"""Share of a step's work below which leaving an effect out gains nothing. Lobes, the cheapest, are 0.5 % of one."""

OFF_BELOW = 0.5
"""An effect goes off where its bound is under this share of the tolerance, and on again above the whole: what lies
between stays as it is, so that a plan does not flicker."""

GRADIENT_TOLERANCE = 0.5
"""Largest relative change of the gradient of anything that is learnt."""


def decide(measured: Measured | None, was_off: bool, tolerance: float = TOLERANCE_DB) -> tuple[Verdict, str]:
    """Whether an effect may be left out, and why (not), in words. ``tolerance``: dB of PSNR.

    A probe that has failed (None) or found something that is not finite means on.
    """
    if measured is None:
        return "on", "not probed, or the probe failed"
    if not measured.finite:
        return "on", "the probe found a figure that is not finite"
    if measured.share < LEAST_SHARE:
        return "on", f"takes {100 * measured.share:.1f} % of a step: nothing to gain"
    factor = 1.0 if was_off else OFF_BELOW
    if measured.bound >= factor * tolerance:
        return "on", f"may cost {measured.bound:.3f} dB, {factor * tolerance:.3f} are tolerated"
    if measured.tail >= factor:
        return "on", f"one tile loses {measured.tail:.2f} of what is tolerated locally"
    if measured.gradient >= factor * GRADIENT_TOLERANCE:
        return "on", f"gradients change by {100 * measured.gradient:.0f} %"
    return "off", f"costs at most {measured.bound:.3f} dB, saves {100 * measured.share:.0f} % of a step"
