"""Maps of radiance against images: direct and indirect light sum to what the image shows."""

from collections.abc import Iterator, Sequence

import numpy as np

from ..findings import Finding
from .cameras import Array
from .colours import DISPLAY, decoded
from .evidence import Evidence, Truth

DARK = 0.01
"""Radiance below which ratios are noise; it is added to both sides."""

CLIPPED = 0.98
"""Display value from which on an image may be clipped."""

OFF, EXPLAINED = 0.06, 0.4
"""Median ratio of radiance, natural logarithm, from which on a sum contradicts its image, and the share of it that
another reading may leave."""

MOST_BEYOND, BEYOND = 0.05, 1.05
"""Share of the pixels whose indirect light may exceed the whole by this factor."""

FEWEST = 30


def radiance(evidence: Evidence) -> Iterator[Finding]:
    """Test views whose direct and indirect light do not sum to their image, or whose indirect light exceeds it."""
    whole = [truth for truth in evidence.truths if {"direct", "indirect"} <= truth.maps.keys()]
    for truth in whole:
        yield from _sum(truth, whole)
    for truth in evidence.truths:
        pairs = [("indirect", "image")] if "direct" not in truth.maps else []
        pairs += [(name, name.removesuffix("/indirect")) for name in truth.maps if name.endswith("/indirect")]
        for name, image in pairs:
            if name in truth.maps and image in truth.maps:
                yield from _beyond(truth, name, image)


def _apart(linear: Array, whole: Array) -> float:
    """Median ratio of two radiances, as a natural logarithm."""
    return float(np.median(np.abs(np.log(linear.clip(0) + DARK) - np.log(whole.clip(0) + DARK))))


def _sum(truth: Truth, others: Sequence[Truth]) -> Iterator[Finding]:
    image = truth.maps["image"]
    chosen = truth.solid & (image.max(-1) < CLIPPED)
    if int(chosen.sum()) < FEWEST:
        return
    shown, direct, indirect = image[chosen], truth.maps["direct"][chosen], truth.maps["indirect"][chosen]
    own = _apart(decoded(shown), direct + indirect)
    if own < OFF:
        return
    ratio = float(np.exp(np.median(np.log((direct + indirect).clip(0) + DARK) - np.log(decoded(shown) + DARK))))
    tried = [(f"the image has {says}", _apart(decoded(read(shown)), direct + indirect)) for says, read in DISPLAY]
    tried += [
        ("direct light holds the whole radiance already", _apart(decoded(shown), direct)),
        ("direct and indirect light are stored as display sRGB",
         _apart(decoded(shown), decoded(direct.clip(0, 1)) + decoded(indirect.clip(0, 1)))),
        ("red and blue of direct and indirect light exchanged", _apart(decoded(shown), (direct + indirect)[..., ::-1])),
        (f"the image {ratio:.2g} times as bright", _apart(decoded(shown) * ratio, direct + indirect)),
    ]  # fmt: skip
    for other in others:
        if other is not truth and other.maps["image"].shape == image.shape:
            swapped = other.maps["image"][chosen]
            theirs = other.maps["direct"][chosen] + other.maps["indirect"][chosen]
            tried.append((f"the image of {other.name}", _apart(decoded(swapped), direct + indirect)))
            tried.append((f"the radiance of {other.name}", _apart(decoded(shown), theirs)))
    says, least = min(tried, key=lambda each: each[1])
    what = f"direct and indirect light do not sum to its image ({100 * (np.exp(own) - 1):.0f} % off in the median)"
    yield Finding(truth.name, f"{what}: {says} fits" if least < EXPLAINED * own else what, "warning")


def _beyond(truth: Truth, name: str, image: str) -> Iterator[Finding]:
    shown = truth.maps[image]
    chosen = truth.solid & (shown.max(-1) < CLIPPED)
    if int(chosen.sum()) < FEWEST:
        return
    whole = decoded(shown[chosen])
    beyond = (truth.maps[name][chosen] > BEYOND * whole + DARK).any(-1)
    share = float(beyond.mean())
    if share > MOST_BEYOND:
        tried = [(says, float((truth.maps[name][chosen] > BEYOND * decoded(read(shown[chosen])) + DARK).any(-1).mean()))
                 for says, read in DISPLAY]  # fmt: skip
        says, least = min(tried, key=lambda each: each[1])
        what = f"{name} exceeds the whole radiance of {image} at {100 * share:.0f} % of the pixels"
        fits = least < 0.2 * share
        yield Finding(truth.name, f"{what}: it does not if the image has {says}" if fits else what, "warning")
