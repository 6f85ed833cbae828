"""Changes single bytes of a finished run's files and reads them back: each change is seen, or changes nothing.

    python tests/bench/flips.py [COUNT] [SEED]

Prints how many changes of each kind of file were seen, how many left what is read bit for bit as it was (such as one
in white space, or in a field of an archive that no reader looks at), how many changed it with nothing said ("silent"),
and how many ended in an error that no reader expects. Exit code 1 if there is any of the latter two.
"""

import json
import random
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import Any

import torch

from bench.fake_method import CPU, FakeSweep, asked, fake_cell, write_sweep
from radiogs_bench.cli import main
from radiogs_bench.errors import StoreError
from radiogs_bench.results.baseline import read_baseline
from radiogs_bench.runs.stages import trained
from radiogs_bench.runs.sweep import read_sweep
from radiogs_bench.runs.trained_folder import Origin, read_about, write_trained
from radiogs_bench.store.folder import Store, product_name
from radiogs_bench.store.seal import Broken
from radiogs_bench.store.tensor_file import read_tensors
from radiogs_core.errors import DataError
from radiogs_reports.summary import read_summary

Read = Callable[[Path], Any]
SEEN = (Broken, DataError, StoreError)


def finished(folder: Path) -> None:
    """A run with everything that is stored: cells, arrays, products, manifest, summary, baseline, a trained model."""
    sweep, request = FakeSweep(folder), asked(1)
    cells = request.cells()
    write_sweep(sweep.store, request.manifest([place for place, _ in cells]))
    sweep.run([cell for _, cell in cells])
    for command in (["report"], ["gate", "--baseline", str(folder / "baseline.json"), "--update"]):
        assert main([command[0], str(folder), *command[1:]]) == 0
    key = cells[0][1].key
    result = sweep.store.sealed_result(key)
    words = {"what": "out of memory", "why": "a made-up failure", "remedy": "none", "exit_code": 1, "date": "today"}
    failure = {name: result[name] for name in ("schema", "key", "scene", "cell")}  # type: ignore[literal-required]
    sweep.store.put_failure(failure | words)  # type: ignore[arg-type]
    cell = fake_cell()
    scene = replace(request.scenes["fake"], train=request.scenes["fake"].test)
    write_trained(sweep.store, Origin("fake", "smoke", {}), scene, cell, trained(sweep.bench, cell, scene)[0])


def readers(folder: Path) -> dict[str, tuple[list[Path], Read]]:
    """Files of each kind, and how one of them is read: what comes back is compared."""

    def arrays(path: Path) -> str:
        store = Store(folder)
        store.check_arrays(store.sealed_result(path.stem))
        return "whole"

    def summary(path: Path) -> Any:
        try:
            return read_summary(folder)
        except ValueError as error:  # the reports do not know the harness's errors
            raise Broken(str(error)) from error

    cells, keys = folder / "cells", Store(folder).result_keys()
    return {
        "cell": ([cells / f"{key}.json" for key in keys], lambda p: Store(folder).sealed_result(p.stem)),
        "failure": ([*cells.glob("*.failed.json")], lambda p: Store(folder).sealed_failure(p.name.partition(".")[0])),
        "arrays": ([*cells.glob("*.npz")], arrays),
        "tensors": ([*(folder / "stages").glob("*.pt")], lambda p: read_tensors(p, product_name(p.stem), CPU)),
        "sweep.json": ([folder / "sweep.json"], lambda p: read_sweep(folder)),
        "summary.json": ([folder / "summary.json"], summary),
        "trained.json": ([folder / "trained.json"], lambda p: read_about(folder)),
        "baseline": ([folder / "baseline.json"], read_baseline),
    }


def outcome(path: Path, read: Read, place: int, bits: int) -> str:
    """The outcome of one changed byte; the file is put back."""
    whole, before = path.read_bytes(), read(path)
    content = bytearray(whole)
    content[place] ^= bits
    path.write_bytes(content)
    try:
        return "harmless" if same(read(path), before) else "silent"
    except SEEN:
        return "seen"
    except Exception:  # noqa: BLE001  counted, and shown
        sys.stderr.write(f"{path.name}, byte {place} ^ {bits}\n{traceback.format_exc()}")
        return "unexpected"
    finally:
        path.write_bytes(whole)


def same(one: Any, other: Any) -> bool:
    """Equal in every value and every type."""
    if type(one) is not type(other):
        return False
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, torch.Tensor):
        return one.dtype == other.dtype and torch.equal(one, other)
    return bool(one == other)


def flips(folder: Path, count: int, seed: int) -> dict[str, Counter[str]]:
    """Outcomes of ``count`` changes, spread evenly over the kinds of files, by kind."""
    numbers, kinds = random.Random(seed), readers(folder)
    found: dict[str, Counter[str]] = {kind: Counter() for kind in kinds}
    for number in range(count):
        kind = list(kinds)[number % len(kinds)]
        files, read = kinds[kind]
        path = numbers.choice(sorted(files))
        found[kind][outcome(path, read, numbers.randrange(path.stat().st_size), numbers.randrange(1, 256))] += 1
    return found


def run() -> int:
    """The command."""
    count, seed = (int(given or usual) for given, usual in zip_longest(sys.argv[1:], (2000, 0)))
    with tempfile.TemporaryDirectory() as place:
        finished(Path(place))
        found = flips(Path(place), count, seed)
    sys.stdout.write(json.dumps(found, indent=1) + "\n")
    return int(any(counts["silent"] or counts["unexpected"] for counts in found.values()))


if __name__ == "__main__":
    sys.exit(run())
