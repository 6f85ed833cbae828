"""The decision rule: an effect is left out only if evidence shows that it matters little, and if that saves work."""

from .evidence import Measured, Verdict
from .tolerance import TOLERANCE_DB

LEAST_SHARE = 0.001
"""Least share of a step's work that an effect must take to be left out. Specular lobes, the cheapest, take 0.5 %."""

OFF_BELOW = 0.5
"""Hysteresis: an effect is switched off if its bound is below this share of the tolerance, and on again above the whole
tolerance; between the two its state does not change."""

GRADIENT_TOLERANCE = 0.5
"""Largest tolerated relative change of the gradient of anything that is learnt."""


def decide(measured: Measured | None, was_off: bool, tolerance: float = TOLERANCE_DB) -> tuple[Verdict, str]:
    """Verdict ("on" or "off") about one effect, with the reason in words. ``tolerance``: dB of PSNR.

    The effect stays on if the probe failed (``measured`` is None) or measured a value that is not finite.
    """
    if measured is None:
        return "on", "not probed, or the probe failed"
    if not measured.finite:
        return "on", "the probe measured a value that is not finite"
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
