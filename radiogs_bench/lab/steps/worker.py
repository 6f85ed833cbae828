"""A process that makes passes for another one: ``python -m radiogs_bench.lab.steps.worker METHOD SCENE DEVICE N``.

It answers each line of JSON on its standard input, ``{"size": NAME, "counts": true or false}``, by one on its standard
output; the first line says where its sources lie. N: stages to go through; 0 for everything.
"""

import json
import os
import sys
from functools import partial
from pathlib import Path

import torch

import radiogs_core
from radiogs_core.kernels.runtime import use_threads
from radiogs_datasets import load_scene

from ...methods import method
from ...store.provenance import git_state
from ...trusted_methods import trusting
from .measure import Here, Plain
from .sizes import size_of
from .subject import Subject, subject_of

SOURCES = Path(radiogs_core.__file__).parent


def main(arguments: list[str]) -> None:
    """Answer until the input ends."""
    *given, stages = arguments
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # whatever else is printed goes to stderr
    pin()
    use_threads(1)
    here = Here(partial(named_subject, *given), int(stages) or None)
    answers.write(json.dumps({"sources": str(SOURCES), "git": git_state(SOURCES)}) + "\n")
    for line in sys.stdin:
        asked: Plain = json.loads(line)
        answers.write(json.dumps(here.passed(asked["size"], asked["counts"])) + "\n")


def named_subject(found_as: str, scene: str, device: str, size: str) -> Subject:
    """A subject from names."""
    with trusting([found_as]):  # the process that started this one names it
        used = method(found_as)
    return subject_of(used, load_scene(scene), size_of(size), torch.device(device))


def pin() -> None:
    """Stay on one core, the same for every process of a comparison."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


if __name__ == "__main__":
    main(sys.argv[1:])
