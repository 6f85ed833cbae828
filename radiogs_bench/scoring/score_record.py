"""Records of scores (schema ``radiogs-bench/score/1``, docs/protocols.md): metrics, by which conventions, of what."""

from collections.abc import Mapping, Sequence
from typing import Any

from radiogs_core.scene.scene import Scene

from ..store.provenance import versions
from ..store.schema import MetricValue
from .metrics.protocol import Protocol

SCHEMA = "radiogs-bench/score/1"
NOTES = ("remarks", "absent", "missing", "ignored")
"""Keys of a record's lists of sentences for people."""


def record_of(
    source: str,
    code: str,
    scene: Scene | None,
    protocols: Mapping[str, dict[str, Any]],
    files: Mapping[str, Any] | None = None,
    **notes: Sequence[str],
) -> dict[str, Any]:
    """The record of scores of ``code``'s output at ``source``. ``protocols``: see ``scored``. ``notes``: ``NOTES``."""
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
