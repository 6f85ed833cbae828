"""Device and threads from the options."""

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import torch


def chosen_device(options: argparse.Namespace) -> "torch.device":
    """The device that the options name; sets the number of threads. Raises UsageError where there is none."""
    from ..device import use

    return use(options.device, options.threads)
