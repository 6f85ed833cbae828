"""Exposure, white balance and the transfer curve over views, by the colours of points that several views show."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from ..findings import Finding, warning
from .cameras import Array, Fit, best
from .colours import DISPLAY, decoded, encoded
from .evidence import Evidence
from .matches import matched
from .surface import at_points, sampled, seen, surface_of

FEWEST, FEWEST_VIEWS = 25, 4
"""Points of a view, and views, below which no finding is made."""

USUAL_SPREAD, VARIED = 0.03, 0.12
"""Spreads of gains over views, natural logarithm: what shading and few points explain, and what is too much."""

ALONE, ALONE_IN_CAPTURES, TIMES = 0.15, 0.8, 6.0
"""Gain of a single view, natural logarithm, from which on it is named (in captures matches lie at highlights, and
cameras expose each photo by itself), and its multiple of the spread."""

EXPLAINED, SUSPECT, SOUND = 0.5, 0.03, 1.5
"""Share of a difference of colours that another reading may leave, the difference below which no reading is tried, and
the largest remaining difference under a named cause, in medians over all views."""

WHAT = "its colours contradict those of other views"

DARK = 0.01


@dataclass(frozen=True)
class Pairs:
    """Display colours of a view's points, and of the same points in other views [points, 3]."""

    own: Array
    other: Array

    def gain(self) -> Array:
        """Median ratio of linear colours by channel, as a natural logarithm."""
        unclipped = (self.own.max(1) < 0.98) & (self.other.max(1) < 0.98)
        ratio = np.log(decoded(self.own) + DARK) - np.log(decoded(self.other) + DARK)
        return np.asarray(np.median(ratio[unclipped] if unclipped.sum() >= FEWEST else ratio, axis=0))

    def difference(self, own: Array) -> float:
        """Median difference of colours if the view's were others."""
        return float(np.median(np.abs(own - self.other).mean(1)))

    def without_gain(self) -> float:
        """Median difference of colours if the view's exposure and white balance were the other views'."""
        return self.difference(encoded(decoded(self.own) / np.exp(self.gain())))


def exposure(evidence: Evidence) -> Iterator[Finding]:
    """Views brighter, darker or of another tint than the others show the same points, and curves applied twice."""
    pairs, alone = _by_surface(evidence), ALONE
    if not pairs:
        pairs, alone = _by_matches(evidence), ALONE_IN_CAPTURES
    if len(pairs) < FEWEST_VIEWS:
        return
    own = {place: each.difference(each.own) for place, each in pairs.items()}
    fits = {}
    for place, each in pairs.items():
        fit = best((says, each.difference(read(each.own))) for says, read in DISPLAY)
        # A curve darkens or brightens, too: it is the cause only where it fits better than a gain.
        if own[place] >= SUSPECT and fit.cost < min(EXPLAINED * own[place], each.without_gain()):
            fits[place] = fit
    usual = float(np.median([fits[place].cost if place in fits else own[place] for place in pairs]))
    sound = max(SUSPECT, SOUND * usual)
    yield from (warning(evidence.looks[place].name, fit.explains(WHAT, sound)) for place, fit in fits.items())
    yield from _gains(evidence, {place: each for place, each in pairs.items() if place not in fits}, alone, sound)


def _gains(evidence: Evidence, pairs: dict[int, Pairs], alone: float, sound: float) -> Iterator[Finding]:
    if len(pairs) < FEWEST_VIEWS:
        return
    places = list(pairs)
    gains = np.stack([pairs[place].gain() for place in places])
    apart = gains - np.median(gains, axis=0)
    spread = max(float(np.median(np.abs(apart).max(1))), USUAL_SPREAD)
    if spread > VARIED * alone / ALONE:
        what = f"exposure or white balance varies over views: by {100 * (np.exp(spread) - 1):.0f} % in the median"
        yield warning("all views", what)
        return
    # Highlights, unlike exposure, keep most of their difference without the gain.
    left = np.array([each.without_gain() for each in pairs.values()])
    explained = left < EXPLAINED * np.array([each.difference(each.own) for each in pairs.values()])
    for place, gain, own, alike, cost in zip(places, apart, gains, explained, left.tolist(), strict=True):
        # A view may also stand apart because most of the others are brighter or darker.
        by_gain = alike if np.abs(own).max() > np.abs(gain).max() / 2 else explained.mean() > 0.5
        if by_gain and np.abs(gain).max() > max(alone, TIMES * spread):
            factors = ", ".join(f"{value:.2f}" for value in np.exp(gain))
            says = f"another exposure, white balance or light (red, green and blue {factors} times others')"
            yield warning(evidence.looks[place].name, Fit(says, cost).explains(WHAT, sound))


def _by_surface(evidence: Evidence) -> dict[int, Pairs]:
    """Colours of each view's points, and of the same points in the test view whose depth they come from."""
    surface = surface_of(evidence.truths)
    if surface is None:
        return {}
    colour = surface.values(evidence.truths, "image")
    names = [truth.name for truth in evidence.truths]
    pairs = {}
    for place, look in enumerate(evidence.looks):
        at, visible = seen(surface, evidence.cameras.take([place]))
        if look.name in names and not look.trained:
            visible &= surface.view != names.index(look.name)
        found, alpha = sampled(look, at[visible])
        solid = alpha > 0.99
        if int(solid.sum()) >= FEWEST:
            pairs[place] = Pairs(found[solid], colour[visible][solid])
    return pairs


def _by_matches(evidence: Evidence) -> dict[int, Pairs]:
    """Colours around matched points in each view, and in the views that they match."""
    matches = matched(evidence)
    blurred = [cv2.GaussianBlur(look.image, (0, 0), 1.5) for look in evidence.looks]
    pairs = {}
    for place in np.unique(matches.views).tolist():
        own = matches.of(place)
        own = own.some(np.flatnonzero(own.agreeing(evidence.cameras)))
        if len(own.views) >= FEWEST:
            shown = [zip(own.views[:, side], own.at[:, side], strict=True) for side in (0, 1)]
            pairs[place] = Pairs(*(np.concatenate([at_points(blurred[view], at[None]) for view, at in each]) / 255
                                   for each in shown))  # fmt: skip
    return pairs
