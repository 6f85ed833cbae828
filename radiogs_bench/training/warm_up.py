"""Compiling the kernels before anything is timed."""

from collections.abc import Iterable
from dataclasses import replace

import torch

from radiogs.budget import budget
from radiogs.variant import Variant
from radiogs_core.scene.scene import Scene

from ..experiments.method import Method

VIEWS = 2
"""As few as span a scene."""


def compile_kernels(method: Method, scene: Scene, device: torch.device, variants: Iterable[Variant]) -> None:
    """Take one step of each stage on a few views, so that every kernel is compiled (once a machine, by its cache).

    Else the first cell of a machine's life would be charged for half a minute of compiling. Those of probes are
    compiled if any of ``variants`` is probed.
    """
    little, cost = replace(scene, train=scene.train[:VIEWS]), budget("smoke")
    first = method.initialise(little, Variant(), cost, 0, device)
    first.step()
    for effects in ("all", "auto") if any(variant.effects == "auto" for variant in variants) else ("all",):
        method.invert(little, Variant(effects=effects), cost, 0, device, first.state()).step()
