"""How far the training is that fills a folder, for ``status`` where no run has left its manifest."""

import json
import time
from dataclasses import asdict
from pathlib import Path

from ..durations import time_left
from ..store.folder import Store
from ..store.pace import Pace, paces
from .reporter import say, say_whole


def is_training(folder: Path) -> bool:
    """Whether ``train`` works in a folder, or has left a model there."""
    return bool(paces(Store(folder))) or (folder / "trained.json").exists()


def show_training(folder: Path, plain: bool, every: int | None) -> None:
    """A line, or with ``plain`` a JSON object; one every so many seconds until it has ended."""
    while True:
        working = paces(Store(folder))
        if plain:
            say_whole(json.dumps({"training": [asdict(pace) for pace in working]}, allow_nan=False))
        else:
            for pace in working:
                say(line_of(pace))
            if not working:
                say(f"trained: see {folder / 'trained.json'}" if (folder / "trained.json").exists() else "stopped")
        if every is None or not working:
            return
        time.sleep(every)


def line_of(pace: Pace) -> str:
    """Such as ``stage 2, inverse rendering: 466 of 3,000, about 41 min left``."""
    left = "" if pace.seconds_left is None else f", about {time_left(pace.seconds_left)} left of it"
    return f"{pace.task}: {pace.done:,} of {pace.total:,}{left}"
