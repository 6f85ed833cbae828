"""Compiling the kernels before anything is timed."""

from dataclasses import replace

import torch

from radiogs.budget import budget
from radiogs.scene import Scene
from radiogs.variant import Variant

from .method import Method

VIEWS = 2
"""As few as span a scene."""


def compile_kernels(method: Method, scene: Scene, device: torch.device) -> None:
    """Take one step of each stage on a few views, so that every kernel is compiled (once a machine, by its cache).

    Else the first cell of a machine's life would be charged for half a minute of compiling.
    """
    little, cost = replace(scene, train=scene.train[:VIEWS]), budget("smoke")
    first = method.initialise(little, Variant(), cost, 0, device)
    first.step()
    method.invert(little, Variant(), cost, 0, device, first.state()).step()
