"""Scores other programs' results: a folder of predictions of a scene, under one protocol or several."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from radiogs_baselines.outputs.predictions import Predictions
from radiogs_core.scene.scene import Scene, View

from ..store.schema import MetricValue
from .metrics.protocol import Protocol
from .metrics_by_view import MetricsByView
from .recovered_light import score_light, withhold_light
from .report_arrays import ReportArrays
from .score_maps import Maps, compared_indirect, coverage, lit_views, score_albedo, score_depth, score_view, truth

Advance = Callable[[int, int], None]

Image = Float[Tensor, "height width 3"]
Grey = Float[Tensor, "height width 1"]


@dataclass(frozen=True)
class Score:
    """Metrics under one protocol; ``albedo_scale``: the factor per channel that aligned the albedo, if any."""

    protocol: Protocol
    metrics: dict[str, MetricValue]
    albedo_scale: list[float] | None


def score_predictions(
    predictions: Predictions,
    scene: Scene,
    protocols: Sequence[Protocol],
    advance: Advance = lambda done, total: None,
    report: ReportArrays | None = None,
) -> list[Score]:
    """Compare everything that a folder predicts with the scene's ground truth; every file is read once.

    With several lights there are metrics of each light (``relight/<light>/psnr``), and of all together
    (``relight/psnr``) only if every light was rendered: a mean over fewer lights would not be comparable. ``advance``
    is called with (done, total) views. ``report`` collects what is compared, with the albedo as the last protocol
    aligns it. Raises DataError for a damaged file or one of the wrong size.
    """
    by_protocol = [MetricsByView(rules.on(scene.layout), [view.name for view in scene.test]) for rules in protocols]
    lit = lit_views(scene, scene.test) if predictions.relit and not scene.surrounded else {}
    report = ReportArrays(scene, lit, 0) if report is None else report
    total = len(scene.test) + sum(map(len, lit.values()))
    kept: dict[str, Maps] = {}
    for done, view in enumerate(scene.test, start=1):
        maps = predictions.read(view, coverage(view))
        for each in by_protocol:
            score_view(each, view, maps, scene.extent)
            _withhold_missing(each, view, maps)
        report.add(view, maps)
        kept[view.name] = {name: maps[name] for name in ("albedo", "alpha", "depth") if name in maps}
        advance(done, total)
    pairs = [(light, view) for light, views in lit.items() for view in views]
    for done, (light, view) in enumerate(pairs, start=len(scene.test) + 1):
        if view.name in predictions.relit.get(light, {}):
            image = predictions.read_relit(light, view, coverage(view))
            _score_relit(by_protocol, light, view, image, kept[view.name].get("alpha"), several=len(lit) > 1)
            report.add_relit(view, light, {"image": image}, truth(view, f"relit/{light}"))
        else:
            for each in by_protocol:
                missing = each.rules.no_comparison(f"not every view is there under '{light}'")
                each.add("relight", view.name, missing)
        advance(done, total)
    if (found := predictions.read_light()) is not None:
        score_light(by_protocol, scene, found)
        report.add_light(found)
    scores = []
    for each in by_protocol:
        score_depth(each, scene, kept)
        scale = score_albedo(each, scene, kept)
        withhold_light(each, scene)
        scores.append(Score(each.rules, each.metrics(), None if scale is None else scale.tolist()))
        report.add_albedo(kept, scale)
    return scores


def _withhold_missing(scores: MetricsByView, view: View, maps: Maps) -> None:
    """Record which maps of a view have a truth but no prediction; relit images are recorded separately."""
    looked_for = {"nvs": "image", "indirect": compared_indirect(scores.rules)}
    for task in ("nvs", "normal", "depth", "roughness", "indirect", "albedo"):
        name = looked_for.get(task, task)
        if name not in maps and view.has("image" if task == "nvs" else task):
            scores.withhold(task, view.name, f"there is no prediction of '{name}' for view '{view.name}'")


def _score_relit(
    by_protocol: Sequence[MetricsByView], light: str, view: View, image: Image, alpha: Grey | None, *, several: bool
) -> None:
    """Score one relit image; ``alpha`` is the view's predicted coverage."""
    mask, target = coverage(view), truth(view, f"relit/{light}")
    for each in by_protocol:
        scores = each.rules.score_image(image, target, mask, alpha, "relight")
        each.add("relight", view.name, scores)
        if several:
            each.add(f"relight/{light}", view.name, scores)
