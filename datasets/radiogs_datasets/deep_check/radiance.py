"""Maps of radiance against images: direct and indirect light sum to what the image shows."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ..findings import Finding, warning
from .cameras import Array, Fit, best
from .colours import DISPLAY, decoded
from .evidence import Evidence, Truth

DARK, CLIPPED = 0.01, 0.98
"""Radiance below which ratios are noise (it is added to both sides), and display value from which an image may clip."""

OFF, EXPLAINED = 0.06, 0.4
"""Median ratio (natural logarithm) at which a sum contradicts its image, and the share another reading may leave."""

MOST_BEYOND, BEYOND = 0.05, 1.05
"""Share of the pixels whose indirect light may exceed the whole by this factor."""

FEWEST = 30


def radiance(evidence: Evidence) -> Iterator[Finding]:
    """Findings on test views whose direct and indirect light do not sum to the image, or whose indirect exceeds it."""
    whole = [truth for truth in evidence.truths if {"direct", "indirect"} <= truth.maps.keys()]
    for truth in whole:
        if int((chosen := _unclipped(truth, "image")).sum()) >= FEWEST:
            yield from _sum(truth, whole, chosen)
    for truth in evidence.truths:
        pairs = [("indirect", "image")] if "direct" not in truth.maps else []
        pairs += [(name, name.removesuffix("/indirect")) for name in truth.maps if name.endswith("/indirect")]
        for name, image in pairs:
            if {name, image} <= truth.maps.keys() and int((chosen := _unclipped(truth, image)).sum()) >= FEWEST:
                yield from _beyond(truth, name, image, chosen)


def _unclipped(truth: Truth, image: str) -> NDArray[np.bool_]:
    """Pixels in which an image is not clipped."""
    return np.asarray(truth.solid & (truth.maps[image].max(-1) < CLIPPED))


def _apart(linear: Array, whole: Array) -> float:
    """Median ratio of two radiances, as a natural logarithm."""
    return float(np.median(np.abs(np.log(linear.clip(0) + DARK) - np.log(whole.clip(0) + DARK))))


def _sum(truth: Truth, others: Sequence[Truth], chosen: NDArray[np.bool_]) -> Iterator[Finding]:
    display, direct, indirect = (truth.maps[name][chosen] for name in ("image", "direct", "indirect"))
    shown, whole = decoded(display), direct + indirect
    own = _apart(shown, whole)
    if own < OFF:
        return
    ratio = float(np.exp(np.median(np.log(whole.clip(0) + DARK) - np.log(shown + DARK))))
    tried = [(f"the image has {says}", _apart(decoded(read(display)), whole)) for says, read in DISPLAY]
    tried += [
        ("direct light holds the whole radiance already", _apart(shown, direct)),
        ("indirect light holds the whole radiance already", _apart(shown, indirect)),
        ("direct and indirect light are stored as display sRGB",
         _apart(shown, decoded(direct.clip(0, 1)) + decoded(indirect.clip(0, 1)))),
        ("red and blue of direct and indirect light exchanged", _apart(shown, whole[..., ::-1])),
        (f"the image {ratio:.2g} times as bright", _apart(shown * ratio, whole)),
    ]  # fmt: skip
    for other in others:
        if other is not truth and other.maps["image"].shape == truth.maps["image"].shape:
            theirs = other.maps["direct"][chosen] + other.maps["indirect"][chosen]
            tried.append((f"the image of {other.name}", _apart(decoded(other.maps["image"][chosen]), whole)))
            tried.append((f"the radiance of {other.name}", _apart(shown, theirs)))
    what = f"direct and indirect light do not sum to its image ({100 * (np.exp(own) - 1):.0f} % off in the median)"
    # Where indirect light is faint, either of its parts may be the whole, and either side have the wrong curve.
    fits = " or ".join(says for says, cost in tried if cost < min(OFF, EXPLAINED * own))
    yield warning(truth.name, Fit(fits, 0.0).explains(what, OFF))


def _beyond(truth: Truth, name: str, image: str, chosen: NDArray[np.bool_]) -> Iterator[Finding]:
    display, part = truth.maps[image][chosen], truth.maps[name][chosen]
    shown = {"": display} | {says: read(display) for says, read in DISPLAY}
    shares = {says: float((part > BEYOND * decoded(each) + DARK).any(-1).mean()) for says, each in shown.items()}
    if (share := shares.pop("")) > MOST_BEYOND:
        fit = best((f"the image with {says}", other) for says, other in shares.items())
        what = f"{name} exceeds the whole radiance of {image} at {100 * share:.0f} % of the pixels"
        yield warning(truth.name, fit.explains(what, 0.2 * share))
