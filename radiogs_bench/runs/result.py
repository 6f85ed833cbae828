"""A cell's result for an experiment to fill in: all keys exist, and what is not measured stays empty."""

from collections.abc import Sequence
from typing import Any

from radiogs_core.instruments import Instruments
from radiogs_core.scene.scene import Scene

from ..store.schema import RESULT_SCHEMA, Data, Result, Session
from .cell import Cell

EVALUATE = "evaluate"
"""The last stage of every result: scoring."""


def empty_result(cell: Cell, protocol: dict[str, Any]) -> Result:
    """The result of a cell before anything is measured; ``protocol`` describes the metrics' conventions."""
    return blank_result(cell.key, cell.scene, cell.content(), protocol)


def blank_result(key: str, scene: str, content: dict[str, Any], protocol: dict[str, Any]) -> Result:
    """The empty result of a cell that is known by its content alone, whose hash is ``key``."""
    return Result(
        schema=RESULT_SCHEMA,
        key=key,
        scene=scene,
        cell=content,
        protocol=protocol,
        metrics={},
        timings={},
        views=[],
        shown_view=None,
        shown_light=None,
        albedo_scale=None,
        facts={},
        recovered={},
        determined={},
        maps=[],
        stages=[],
        losses={},
        trail={},
        seconds={},
        parts={},
        work={},
        guards={},
        sessions={},
    )


def data_of(scene: Scene) -> Data:
    """The number and size of a scene's views."""
    camera = scene.test[0].camera
    return Data(
        layout=scene.layout,
        width=camera.width,
        height=camera.height,
        training_views=len(scene.train),
        test_views=len(scene.test),
    )


def add_stage(result: Result, name: str, recorded: Instruments, seconds: float, sessions: Sequence[Session]) -> None:
    """Enter a stage's seconds, named parts, work, guards and sessions into a result."""
    result["seconds"][name] = seconds
    plain = recorded.plain()
    result["parts"][name], result["work"][name], result["guards"][name] = plain["parts"], plain["work"], plain["guards"]
    result["sessions"][name] = list(sessions)
