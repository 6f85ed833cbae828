"""The maps of one view of somebody's files, as a result stores them (``evaluate.Evaluation.arrays``)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from radiogs_baselines.outputs import Predictions
from radiogs_core.scene.scene import Scene

from .evaluate import LIGHTS_SHOWN, SHOWN
from .kept_views import KeptViews, views_to_keep
from .light_maps import light_maps
from .score_maps import coverage, lit_views, truth


@dataclass(frozen=True)
class ShownFiles:
    """``arrays`` of the middle test view, under ``light`` for its relit map; None if no file shows that."""

    view: str
    light: str | None
    arrays: dict[str, np.ndarray]


def shown_files(predictions: Predictions, scene: Scene, albedo_scale: Sequence[float] | None) -> ShownFiles:
    """``render/<map>`` and ``truth/<map>`` of the middle test view, float32 [height, width, channels], on black.

    Albedo is linear and multiplied by ``albedo_scale``. ``views/...`` as ``KeptViews`` keeps them, as many as fit its
    limit. Raises DataError for a damaged file.
    """
    view = scene.test[len(scene.test) // 2]
    mask = coverage(view)
    arrays = {f"truth/{name}": truth(view, name) for name in SHOWN if view.has(name)}
    maps = predictions.read(view, mask)
    arrays |= {f"render/{name}": maps[name] for name in (*SHOWN, "incident") if name in maps}
    if "albedo" in maps and albedo_scale is not None:
        arrays["render/albedo"] = maps["albedo"] * torch.tensor(albedo_scale, dtype=maps["albedo"].dtype)
    lit = {} if scene.surrounded else lit_views(scene, scene.test)
    first = next((light for light, views in lit.items() if view in views), None)
    shown_light = None
    for place, (light, views) in enumerate(lit.items()):
        if view not in views or view.name not in predictions.relit.get(light, {}):
            continue
        image, target = predictions.read_relit(light, view, mask), truth(view, f"relit/{light}")
        if light == first:
            shown_light = light
            arrays |= {"render/relit": image, "truth/relit": target}
        if place < LIGHTS_SHOWN:
            arrays |= {f"render/relit/{light}": image, f"truth/relit/{light}": target}
    found = predictions.read_light()
    if found is not None and scene.training_light is not None:
        arrays |= light_maps(found, scene.training_light)
    shown = {name: image.cpu().numpy().astype(np.float32) for name, image in arrays.items()}
    return ShownFiles(view.name, shown_light, shown | kept_files(predictions, scene, albedo_scale).codes)


def kept_files(predictions: Predictions, scene: Scene, albedo_scale: Sequence[float] | None) -> KeptViews:
    """Every map and light of as many test views as fit the limit."""
    kept = views_to_keep(scene, None)
    lit = {} if scene.surrounded else lit_views(scene, scene.test)
    for view in (view for view in scene.test if view.name in kept.chosen):
        maps = dict(predictions.read(view, coverage(view)))
        if "albedo" in maps and albedo_scale is not None:
            maps["albedo"] = maps["albedo"] * torch.tensor(albedo_scale, dtype=maps["albedo"].dtype)
        kept.rendered(view, maps)
        for light, views in lit.items():
            if view in views and view.name in predictions.relit.get(light, {}):
                image = predictions.read_relit(light, view, coverage(view))
                kept.relit(view, light, image, truth(view, f"relit/{light}"))
    return kept
