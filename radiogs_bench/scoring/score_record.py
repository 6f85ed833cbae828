"""Records of scores (schema ``radiogs-bench/score/1``, docs/scoring.md): metrics, by which conventions, of what."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import torch

from radiogs_core.contract import Trained
from radiogs_core.scene.scene import Scene

from ..store.provenance import versions
from ..store.schema import MetricValue
from .evaluate import SCORES_ALONE, evaluate
from .metrics.protocol import Protocol

SCHEMA = "radiogs-bench/score/1"
NOTES = ("remarks", "absent", "missing", "ignored")
"""Keys of lists of sentences for people."""


def record_of(
    source: str,
    code: str,
    scene: Scene | None,
    protocols: Mapping[str, dict[str, Any]],
    files: Mapping[str, Any] | None = None,
    **notes: Sequence[str],
) -> dict[str, Any]:
    """The record of what ``code`` wrote, or is, at ``source``. ``protocols``: see ``scored``. ``notes``: ``NOTES``."""
    return {
        "schema": SCHEMA,
        "predictions": source,
        "from": code,
        "versions": versions(),
        "scene": scene and {"name": scene.name, "layout": scene.layout, "checksum": scene.checksum},
        "views": [view.name for view in scene.test] if scene else [],
        "files": dict(files or {}),
        "protocols": dict(protocols),
        **{name: list(notes.get(name, ())) for name in NOTES},
    }


def scored(
    rules: Protocol, metrics: Mapping[str, MetricValue], albedo_scale: list[float] | None = None
) -> dict[str, Any]:
    """The part of a record for one protocol."""
    return {"conventions": rules.describe(), "metrics": dict(metrics), "albedo_scale": albedo_scale}


def record_of_model(
    source: str,
    method: str,
    model: Trained,
    scene: Scene,
    device: torch.device,
    protocols: Sequence[Protocol],
    advance: Callable[[int, int], None],
) -> dict[str, Any]:
    """The record of a trained model, rendered anew for each protocol; errors as those of ``evaluate``."""
    found = {}
    for rules in protocols:
        result = evaluate(model, scene, rules, device, advance, scope=SCORES_ALONE, method=method)
        found[rules.name] = scored(rules, result.metrics, result.albedo_scale)
    return record_of(source, method, scene, found)
