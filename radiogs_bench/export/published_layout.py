"""A trained model's test views, written as a public code writes its own results."""

from collections.abc import Callable, Iterator

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_baselines.outputs.codes import CODES
from radiogs_baselines.outputs.writing import LayoutWriter
from radiogs_core.contract import NotOffered, Run, Trained
from radiogs_core.errors import UsageError, unknown
from radiogs_core.scene.scene import View

from ..scoring.evaluate import SCORES_ALONE, evaluate
from ..scoring.metrics.protocol import Protocol
from ..scoring.rendering import prepared, view_on_black
from ..scoring.score_maps import coverage, lit_views

PLAIN = "plain"
"""Name of the layout that ``render`` and ``relight`` write."""


def write_as_published(
    model: Trained, run: Run, writer: LayoutWriter, method: str, rules: Protocol, advance: Callable[[int, int], None]
) -> int:
    """Write every test view, and every relit one that the scene has; returns the number of files.

    Relit views have their albedo multiplied by the factor that ``rules`` find, so that the folder scores under them as
    the model does. Raises errors of the method as ``evaluate``.
    """
    scale = albedo_scale(model, run, method, rules, advance)
    shown = prepared(method, model)
    further = ("incident",) if "incident" in shown.offers else ()
    for view in run.scene.test:
        writer.write(view, view_on_black(shown, view, run.device, *further, method=method), coverage(view))
    for light, view, maps in relit_views(model, run, method, scale):
        writer.write_relit(light, view, maps, coverage(view))
    return len(writer.written)


def albedo_scale(
    model: Trained, run: Run, method: str, rules: Protocol, advance: Callable[[int, int], None]
) -> Float[Tensor, "3"]:
    """The factors by which ``rules`` multiply the recovered albedo [linear RGB] before they relight it."""
    found = evaluate(model, run.scene, rules, run.device, advance, scope=SCORES_ALONE, method=method)
    return rules.relighting_scale(torch.ones(3) if found.albedo_scale is None else torch.tensor(found.albedo_scale))


def relit_views(
    model: Trained, run: Run, method: str, scale: Float[Tensor, "3"]
) -> Iterator[tuple[str, View, dict[str, Tensor]]]:
    """Light, test view and maps of each relit view with a true image, with albedo times ``scale``; else none."""
    scene = run.scene
    for light, views in {} if scene.surrounded else lit_views(scene, scene.test).items():
        try:
            relit = prepared(method, model, scene.lights[light], scale)
        except NotOffered:
            continue
        for view in views:
            maps = view_on_black(relit, view, run.device, method=method)
            if "image" in maps:
                yield light, view, maps


def checked(code: str) -> str:
    """The layout of this name. Raises UsageError for a layout that cannot be written."""
    if code in CODES and code != PLAIN:
        return code
    layouts = [name for name in CODES if name != PLAIN]
    if code == PLAIN:
        raise UsageError(
            f"`export` does not write layout '{PLAIN}'",
            "`render` and `relight` write this layout.",
            f"Layouts: {', '.join(layouts)}.",
        )
    raise unknown("layout to write", code, layouts)
